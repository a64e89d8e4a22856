"""The same networks in PyTorch, tinycudann and Dr.Jit on one GPU, in float16; each where it is installed.

Timed like ours, as CUDA graphs between events, where PyTorch can capture the call; where it cannot, and Dr.Jit, whose
frozen functions launch recorded kernels, as calls of which a few are under way before the host waits. The table says
which. PyTorch trains in mixed precision, `torch.compile` takes part in one shape; tinycudann has no biases.
"""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np

from perf.measure import WARM_UP, Bench, check, wall_ms
from perf.networks import shape_name, true_gradient, truth
from perf.peers import drjit_evaluator, drjit_net, learning, mean_square, torch_model, weights_and_biases
from warp_neural import MLP

COMPILED, COMPILED_STEP = "3x64", "3x64, 262,144"  # by torch.compile, which may take a minute
CALLS = 8  # in a row
LOSS_SCALE = 2.0**12  # of Dr.Jit, whose gradients pass through float16; Adam does not mind
CHECKED, LIMIT = 4096, 1e-2  # rows, and the relative error of what a peer computes


def installed(bench: Bench) -> list[str]:
    """Peers by module; PyTorch only if it sees the GPU."""
    found = [name for name in ("torch", "tinycudann", "drjit") if find_spec(name)]
    if "torch" in found:
        import torch

        if not torch.cuda.is_available():
            found = [name for name in found if name == "drjit"]
    bench.result.settings["peers installed"] = ", ".join(found) or "none"
    return found


def shape_of(net: MLP) -> tuple[int, int]:
    return len(net.spec.layers) - 1, net.n_in


def modules(net: MLP, device: str, found: list[str], compiled: bool) -> dict[str, Any]:
    """The network as PyTorch's modules, by peer."""
    if "torch" not in found:
        return {}
    import torch

    made = {"PyTorch eager": torch_model(weights_and_biases(net)).to(device)}
    if compiled:
        made["torch.compile"] = torch.compile(torch_model(weights_and_biases(net)).to(device))
    if "tinycudann" in found:
        import tinycudann

        depth, width = shape_of(net)
        network = {"otype": "FullyFusedMLP", "activation": "ReLU", "output_activation": "None"}
        network |= {"n_neurons": width, "n_hidden_layers": depth}
        made["tinycudann"] = tinycudann.Network(width, net.n_out, network)
        weights = np.concatenate([w.ravel() for w in net.weights])
        with torch.no_grad():
            made["tinycudann"].params.copy_(torch.from_numpy(weights))
    return made


def compared(net: MLP, name: str) -> MLP:
    """What peer `name` computes: `net`, for tinycudann without biases."""
    if name != "tinycudann":
        return net
    bare = MLP(net.n_in, net.n_out, net.n_in, len(net.spec.layers) - 1, device="cpu")
    bare.weights, bare.biases = net.weights, [np.zeros_like(b) for b in net.biases]
    return bare


def add(bench: Bench, row: str, column: str, make: Callable[[], Callable[[], Any]], times: Callable) -> None:
    """`times` of the call that `make` returns after it has checked it. What fails is noted, and stops nothing."""
    try:
        values, note = times(make(), bench.config.rounds)
    except Exception as error:  # of other libraries, their compilers and drivers
        bench.result.settings[f"{row}, {column} failed"] = str(error).strip().split("\n")[0][:200]
        return
    bench.add(row, column, values, "ms", note)


def frozen_times(call: Callable[[], Any], rounds: int) -> tuple[np.ndarray, str]:
    """Milliseconds of a call in each round, [rounds], by the wall clock, and how they were timed."""
    return np.array([wall_ms(call, CALLS) for _ in range(WARM_UP + rounds)][WARM_UP:]), "(frozen calls)"


def graph_times(call: Callable[[], Any], rounds: int) -> tuple[np.ndarray, str]:
    """The same by events, of a graph of CALLS calls, or of the calls themselves where they cannot be captured."""
    import torch

    side = torch.cuda.Stream()
    side.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(side):  # compile and allocate, which a graph cannot
        for _ in range(WARM_UP):
            call()
    torch.cuda.current_stream().wait_stream(side)
    graph, note = torch.cuda.CUDAGraph(), ""

    def repeat() -> None:
        for _ in range(CALLS):
            call()

    replay = graph.replay
    try:
        with torch.cuda.graph(graph):
            repeat()
    except RuntimeError:
        replay, note = repeat, "(calls)"
    events = []
    for _ in range(WARM_UP + rounds):
        begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        begin.record()
        replay()
        end.record()
        events.append((begin, end))
    torch.cuda.synchronize()
    return np.array([begin.elapsed_time(end) / CALLS for begin, end in events[WARM_UP:]]), note


def measure_inference(bench: Bench, net: MLP, x: np.ndarray) -> None:
    """Rows x, float16 [n, n_in], in memory; rows `memory, PEER` of the shape's column."""
    found, column = installed(bench), shape_name(*shape_of(net))
    for name, module in modules(net, "cuda", found, column == COMPILED).items():
        make = lambda: torch_inference(name, net, module, x, "cuda")  # noqa: B023, E731
        add(bench, f"memory, {name}", column, make, graph_times)
    if "drjit" in found:
        add(bench, "memory, Dr.Jit", column, lambda: drjit_inference(net, x), frozen_times)


def torch_inference(name: str, net: MLP, module: Any, x: np.ndarray, device: str) -> Callable[[], Any]:
    import torch

    inputs, module = torch.from_numpy(x).to(device), module if name == "tinycudann" else module.to(torch.float16)

    def call() -> Any:
        with torch.no_grad():
            return module(inputs)

    check(name, call()[:CHECKED].float().cpu().numpy(), truth(compared(net, name), x[:CHECKED]), LIMIT)
    return call


def drjit_inference(net: MLP, x: np.ndarray) -> Callable[[], Any]:
    call = drjit_evaluator(weights_and_biases(net), x, cuda=True)
    y = np.stack([value.numpy()[:CHECKED] for value in call()], 1)
    check("Dr.Jit", y.astype(np.float32), truth(net, x[:CHECKED]), LIMIT)
    return call


def measure_training(bench: Bench, net: MLP, x: np.ndarray, target: np.ndarray) -> None:
    """A step on the same rows: forward, L2, backward, Adam; rows `LxN, BATCH, PEER`."""
    found, row = installed(bench), f"{shape_name(*shape_of(net))}, {len(x):,}"
    for name, module in modules(net, "cuda", found, row == COMPILED_STEP).items():
        make = lambda: torch_training(name, net, module, x, target, "cuda")  # noqa: B023, E731
        add(bench, f"{row}, {name}", "step", make, graph_times)
    if "drjit" in found:
        add(bench, f"{row}, Dr.Jit", "step", lambda: drjit_training(net, x, target), frozen_times)


def torch_training(name: str, net: MLP, module: Any, x: np.ndarray, target: np.ndarray, device: str) -> Callable:
    import torch

    some = len(x) if name == "torch.compile" else min(len(x), CHECKED)  # it compiles again for another size
    inputs, targets = (torch.from_numpy(array).to(device) for array in (x, target))
    optimizer = torch.optim.Adam(module.parameters(), lr=1e-3, fused=True, capturable=device == "cuda")
    scaler = torch.amp.GradScaler(device)

    def gradient(n: int) -> None:
        optimizer.zero_grad()
        with torch.autocast(device, torch.float16, enabled=name != "tinycudann"):
            y = module(inputs[:n])
        scaler.scale(torch.nn.functional.mse_loss(y.float(), targets[:n].float())).backward()

    def step() -> None:
        gradient(len(x))
        scaler.step(optimizer)
        scaler.update()

    gradient(some)
    parts = [parameter.grad.flatten() for parameter in module.parameters()]
    found = torch.cat(parts).float().cpu().numpy() / scaler.get_scale()
    expected = true_gradient(compared(net, name), x[:some], target[:some].astype(np.float64))
    if name == "tinycudann":
        expected = expected[np.concatenate([np.repeat([True, False], [w.size, len(w)]) for w in net.weights])]
    check(f"{name}, gradient", found, expected, LIMIT)
    return step


def drjit_training(net: MLP, x: np.ndarray, target: np.ndarray) -> Callable[[], Any]:
    import drjit as dr
    from drjit import nn
    from drjit.cuda.ad import Float16
    from drjit.opt import Adam

    packed, optimizer = drjit_net(weights_and_biases(net), "training", cuda=True), Adam(lr=1e-3)
    columns, targets = ([Float16(column) for column in array.T.copy()] for array in (x, target))
    optimizer.update(packed)

    @dr.freeze
    def step(packed, optimizer, columns, targets) -> Any:
        packed.update(optimizer)
        loss = mean_square(list(packed(nn.CoopVec(columns))), targets)
        dr.backward(LOSS_SCALE * loss)
        optimizer.step()
        return loss

    return learning(lambda: step(packed, optimizer, columns, targets))
