"""network 1: a picture in the smallest network, one layer of 9 parameters. Leaves step_01.png, the target on the left.

    python -m samples.network.step_01_basic_network [--image FILE]

The network takes (u, v) and gives a colour: three ReLUs of a u + b v + c. Training draws pixels, looks up their colours
and goes down the squared error after gamma 1/2.2, which is about what an eye sees. Expect three soft ramps.

As in the course: one random point in each cell of a 64 x 64 grid, the pixel under it without filtering, Adam. Unlike
it: Xavier's initial weights; a learning rate of 0.01 that falls to a hundredth (there 0.001, for ever); in this step,
outputs that start from grey; on CUDA batches of 16 grids, and float16 (tensor cores) instead of float32. A ReLU without
a grey start may be negative all over the picture: its derivative is 0, and that colour stays black.
"""

from collections.abc import Callable

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.samples.network.target import Config, load_target, psnr, save_beside

GRID = wp.constant(64)


def make_network(**options) -> wn.MLP:
    net = wn.MLP(2, 3, depth=0, output_activation=wn.activations.relu, **options)
    net.biases = [np.full(3, 0.5)]
    return net


@wp.func
def pixel_centre(i: int, j: int, height: int, width: int) -> wp.vec2:
    return wp.vec2((float(j) + 0.5) / float(width), (float(i) + 0.5) / float(height))


@wp.func
def sample(index: int, random: wn.random.Stream, target: wp.array2d[wp.vec3]):
    """The centre (u, v) and the colour of a random pixel in cell `index` of the grid."""
    u = wn.random.uniform(random, 0)
    point = wn.sampling_2d.jittered_2d(index, GRID, GRID, u[0], u[1])
    height, width = target.shape[0], target.shape[1]
    i, j = int(point[1] * float(height)), int(point[0] * float(width))
    return pixel_centre(i, j, height, width), target[i, j]


def render(net: wn.MLP, height: int, width: int) -> np.ndarray:
    """The network at every pixel's centre: linear `[height, width, 3]`."""

    @wp.kernel(module="unique", enable_backward=False)
    def render_kernel(params: net.Params, picture: wp.array2d[wp.vec3]):
        i, j = wp.tid()
        picture[i, j] = net.func(params, pixel_centre(i, j, height, width))

    picture = wp.empty((height, width), dtype=wp.vec3, device=net.device)
    wp.launch(render_kernel, picture.shape, inputs=[net.params, picture], device=net.device)
    return picture.numpy()


def train(config: Config, name: str, make_network: Callable[..., wn.MLP], target: np.ndarray) -> tuple[wn.MLP, float]:
    """The trained network and the seconds that training took, without those of the compiler."""
    device = cli.resolve_device(config.device)
    net = make_network(precision="float16" if device.is_cuda else "float32", seed=config.seed, device=device)
    trainer = wn.Trainer(
        net,
        sample=sample,
        data=wp.array(target, dtype=wp.vec3, device=device),
        loss=wn.losses.gamma_l2,
        optimizer=wn.optim.Adam(lr=wn.optim.cosine(config.rate, config.rate / 100, config.steps)),
        batch=config.batch or (16 if device.is_cuda else 1) * GRID * GRID,
        seed=config.seed,
    )
    return net, cli.train(trainer, config.steps, config, name)  # trainer.run(steps), from a checkpoint if there is one


def fit(config: Config, name: str, make_network: Callable[..., wn.MLP], target: np.ndarray) -> tuple[np.ndarray, dict]:
    """Train, render, save `name`.png: the picture and its metrics."""
    net, seconds = train(config, name, make_network, target)
    picture = render(net, *target.shape[:2])
    save_beside(config.out / f"{name}.png", target, picture)
    return picture, {
        f"psnr_{name}": psnr(picture, target),
        f"parameters_{name}": net.n_parameters,
        f"seconds_{name}": seconds,
    }


def main(config: Config) -> dict:
    return fit(config, "step_01", make_network, load_target(config))[1]


if __name__ == "__main__":
    cli.run(main, Config)
