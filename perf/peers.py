"""The same networks in PyTorch and Dr.Jit, one core, float32; `pip install -e '.[peers]'` brings both. On a GPU see
`perf.peers_cuda`.

Each function takes weights [n_out, n_in] and biases, and returns what the name says, by peer.
"""

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np

from warp_neural import MLP

Layers = list[tuple[np.ndarray, np.ndarray]]


def missing() -> list[str]:
    return [name for name, module in (("PyTorch", "torch"), ("Dr.Jit", "drjit")) if not find_spec(module)]


def torch_model(layers: Layers):
    import torch

    torch.set_num_threads(1)
    modules = []
    for weights, biases in layers:
        linear = torch.nn.Linear(weights.shape[1], weights.shape[0])
        with torch.no_grad():
            linear.weight.copy_(torch.from_numpy(weights))
            linear.bias.copy_(torch.from_numpy(biases))
        modules += [linear, torch.nn.ReLU()]
    return torch.nn.Sequential(*modules[:-1])


def weights_and_biases(net: MLP) -> Layers:
    return [(weights.copy(), biases.copy()) for weights, biases in zip(net.weights, net.biases, strict=True)]


def drjit_types(cuda: bool) -> tuple:
    """Of elements and tensors: float32 on one core, float16 on CUDA."""
    if cuda:
        from drjit.cuda.ad import Float16, TensorXf16

        return Float16, TensorXf16
    from drjit.llvm.ad import Float32, TensorXf

    return Float32, TensorXf


def drjit_net(layers: Layers, layout: str, cuda: bool = False):
    import drjit as dr
    from drjit import nn

    dr.set_thread_count(1)
    tensor = drjit_types(cuda)[1]
    modules = []
    for weights, _ in layers:
        modules += [nn.Linear(-1, len(weights)), nn.ReLU()]
    net = nn.Sequential(*modules[:-1]).alloc(tensor, layers[0][0].shape[1])
    for linear, (weights, biases) in zip(net.layers[::2], layers, strict=True):
        linear.weights, linear.bias = tensor(weights), tensor(biases)
    return nn.pack(net, layout=layout)


def drjit_evaluator(layers: Layers, x: np.ndarray, cuda: bool = False) -> Callable[[], list]:
    """The columns of the results, evaluated; on CUDA by a frozen function, which is traced once."""
    import drjit as dr
    from drjit import nn

    array = drjit_types(cuda)[0]
    net, columns = drjit_net(layers, "inference", cuda), [array(column) for column in x.T.copy()]
    dr.eval(columns)

    def results(net, columns) -> list:
        return list(net(nn.CoopVec(columns)))

    call = dr.freeze(results) if cuda else results

    def evaluate() -> list:
        y = call(net, columns)
        dr.eval(y)
        return y

    return evaluate


def inference(layers: Layers, x: np.ndarray, compiled: bool) -> dict[str, Callable[[], np.ndarray]]:
    """Calls that evaluate x [n, n_in] and give [n, n_out]; `compiled`: with torch.compile too, which takes a minute."""
    calls = {}
    if find_spec("torch"):
        import torch

        model, inputs = torch_model(layers), torch.from_numpy(x)

        def evaluate(function: Callable) -> np.ndarray:
            with torch.no_grad():
                return function(inputs).numpy()

        calls["PyTorch eager"] = lambda: evaluate(model)
        if compiled:
            faster = torch.compile(model)
            calls["torch.compile"] = lambda: evaluate(faster)
    if find_spec("drjit"):
        evaluate_drjit = drjit_evaluator(layers, x)
        calls["Dr.Jit"] = lambda: np.stack([value.numpy() for value in evaluate_drjit()], 1)
    return calls


def training(layers: Layers, octaves: int, n: int, gradient_of: Callable) -> dict[str, Callable[[], None]]:
    """Calls that take one step of n new samples, encode them and update the weights (L2, Adam).

    gradient_of: `(name, inputs, targets, gradient)`, called once with what the first gradient was made from.
    """
    calls = {}
    if find_spec("torch"):
        calls["PyTorch eager"] = torch_step(layers, octaves, n, gradient_of)
    if find_spec("drjit"):
        calls["Dr.Jit"] = drjit_step(layers, octaves, n)
    return calls


def torch_step(layers: Layers, octaves: int, n: int, gradient_of: Callable) -> Callable[[], None]:
    import torch

    model = torch_model(layers)
    torch.manual_seed(0)
    frequencies = torch.pi * 2.0 ** torch.arange(octaves)
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3)

    def gradient():
        x = torch.rand(n, 2)
        u, v = x.unbind(1)
        angles = x[:, :, None] * frequencies
        inputs = torch.stack([angles.sin(), angles.cos()], -1).flatten(1)
        targets = torch.stack([u, u * v, (1 - u) * v], 1)
        optimizer.zero_grad()
        torch.nn.functional.mse_loss(model(inputs), targets).backward()
        return inputs, targets

    inputs, targets = gradient()
    found = torch.cat([parameter.grad.flatten() for parameter in model.parameters()]).numpy()
    gradient_of("PyTorch", inputs.numpy(), targets.numpy(), found)

    def step() -> None:
        gradient()
        optimizer.step()

    return step


def mean_square(y: list, targets: list):
    """Over all of Dr.Jit's columns, in float32: the mean of many squares in float16 loses its gradient."""
    import drjit as dr

    single = dr.float32_array_t(type(y[0]))
    return sum(dr.mean(dr.square(single(a) - single(b))) for a, b in zip(y, targets, strict=True)) / len(y)


def learning(step: Callable) -> Callable:
    """`step`, which returns its loss, after that has fallen: Dr.Jit's gradient lies in a buffer of its own order."""
    losses = [step().numpy()[0] for _ in range(20)]
    if not losses[-1] < losses[0]:
        raise RuntimeError(f"Dr.Jit: the loss went from {losses[0]:.3g} to {losses[-1]:.3g}; nothing was timed")
    return step


def drjit_step(layers: Layers, octaves: int, n: int) -> Callable[[], None]:
    import drjit as dr
    from drjit import nn
    from drjit.llvm.ad import Float32
    from drjit.opt import Adam

    net = drjit_net(layers, "training")
    optimizer, rng = Adam(lr=1e-3), dr.rng(seed=0)
    optimizer.update(net)

    def step() -> Float32:
        net.update(optimizer)
        u, v = rng.random(Float32, n), rng.random(Float32, n)
        waves = [dr.sincos(x * (dr.pi * 2**k)) for x in (u, v) for k in range(octaves)]
        y = list(net(nn.CoopVec([value for pair in waves for value in pair])))
        targets = [u, u * v, (1 - u) * v]
        loss = mean_square(y, targets)
        dr.backward(loss)
        optimizer.step()
        dr.eval(loss)
        dr.sync_thread()
        return loss

    return learning(step)
