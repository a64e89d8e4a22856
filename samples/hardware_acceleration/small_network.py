"""The course's small network, 4-16-4, that learns four functions of (x, y), in all three implementations.

Only the argument `implementation` differs. "per_thread" is the network as a shader would spell it: loops of one thread,
and an atomic addition to memory for every weight's gradient. "tiled" does the products of a whole block with
`wp.tile_matmul`. "cooperative" does those of a warp on tensor cores (float16 there), on the CPU in vector registers.
All three begin with the same weights and draw the same points.
"""

import time

import numpy as np
import warp as wp

import warp_neural as wn

SIDE = wp.constant(64)  # points of the grid that results are compared on, along one side


@wp.func
def features(x: float, y: float) -> wp.vec4:
    return wp.vec4(x, y, x * x, y * y)


@wp.func
def functions(x: float, y: float) -> wp.vec4:
    """What the network learns, of x and y in [0, 1]."""
    return wp.vec4((x + y) / (1.0 + y * y), 2.0 * x + y, 0.5 * x * x + 1.2 * y, x + 0.5 * y * y)


@wp.func
def sample(index: int, random: wn.random.Stream):
    u = wn.random.uniform(random, 0)
    return features(u[0], u[1]), functions(u[0], u[1])


def make_network(implementation: str, seed: int, device: wp.Device) -> wn.MLP:
    half = implementation == "cooperative" and device.is_cuda
    return wn.MLP(
        n_in=4,
        n_out=4,
        width=16,
        depth=1,
        activation=wn.activations.leaky_relu,
        output_activation=wn.activations.leaky_relu,
        precision="float16" if half else "float32",
        implementation=implementation,
        seed=seed,
        device=device,
    )


def train(net: wn.MLP, steps: int, batch: int, seed: int, quiet: bool) -> float:
    """Seconds of a step, without the compiler's."""
    adam = wn.optim.Adam(lr=wn.optim.cosine(0.01, 1e-4, steps))
    trainer = wn.Trainer(net, sample=sample, optimizer=adam, batch=batch, seed=seed)
    return seconds_a_step(trainer, steps, quiet)


def warm_up(device: wp.Device) -> int:
    """Steps before the clock starts: the first compiles; on CUDA 32 become a graph."""
    return 32 if device.is_cuda else 1


def seconds_a_step(trainer: wn.Trainer, steps: int, quiet: bool) -> float:
    """Take `steps`, more than `warm_up`; the time of those after it."""
    trainer.run(warm_up(trainer.device), quiet=True)
    began, rest = time.perf_counter(), steps - trainer.index
    trainer.run(rest, quiet=quiet)
    return (time.perf_counter() - began) / rest


def results(net: wn.MLP) -> tuple[np.ndarray, np.ndarray]:
    """The network and the functions on a grid, [SIDE * SIDE, 4] each."""

    @wp.kernel(module="unique", enable_backward=False, module_options={"enable_mathdx_gemm": False})
    def results_kernel(params: net.Params, found: wp.array[wp.vec4], expected: wp.array[wp.vec4]):
        i = wp.tid()
        x, y = (float(i % SIDE) + 0.5) / float(SIDE), (float(i / SIDE) + 0.5) / float(SIDE)
        found[i] = net.func(params, features(x, y))
        expected[i] = functions(x, y)

    arrays = [wp.empty(SIDE * SIDE, dtype=wp.vec4, device=net.device) for _ in range(2)]
    wp.launch(results_kernel, SIDE * SIDE, inputs=[net.params, *arrays], device=net.device, block_dim=SIDE)
    return arrays[0].numpy(), arrays[1].numpy()


def compare(steps: int, batch: int, seed: int, device: wp.Device, quiet: bool) -> dict[str, float]:
    """Of each implementation: milliseconds a step, the largest error, and how far from per_thread's."""
    metrics, plain = {}, None
    for implementation in ("per_thread", "tiled", "cooperative"):
        net = make_network(implementation, seed, device)
        metrics[f"small_milliseconds_{implementation}"] = 1e3 * train(net, steps, batch, seed, quiet)
        found, expected = results(net)
        plain = found if plain is None else plain
        metrics[f"small_error_{implementation}"] = float(np.abs(found - expected).max())
        metrics[f"small_difference_{implementation}"] = float(np.abs(found - plain).max())
    return metrics
