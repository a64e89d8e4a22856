"""neural texture 1: a grid of latents and a network that makes a texel's channels of them. Leaves step_01.png.

    python -m samples.neural_texture.step_01_latent_texture [--material FOLDER]

As the last step of the network section, for all maps of a material at once: a cell of 2 x 2 texels has four numbers, a
texel reads them bilinearly between four cells, and one small network turns them into albedo, normal and all else.
Training draws texels at random and goes down the squared error, for latents and network alike. In the end latents are
rounded, to 8, 5, 4 and 3 bits, in steps of the smallest squared error.

Expect 31.2 dB at 5.2 bits a texel and 29.3 at 3.2: below 4 bits a latent rounding spoils the picture.
"""

from collections.abc import Callable

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.samples.neural_texture.target import Config, report
from warp_neural.samples.neural_texture.texture import Point, Texture, bilinear
from warp_neural.texture.maps import TextureSet
from warp_neural.train.optim import Adam, cosine

GRIDS = (Grid(2, 4, "bilinear"),)
BITS = 8, 5, 4, 3  # of a latent in a file


def make_features(spec: TextureSpec, vec_in: type) -> wp.Function:
    """What the network reads at texel (i, j): of every latent the weighted sum over the four cells around it."""

    def with_grid(before: wp.Function, g: int) -> wp.Function:
        scale, vectors = spec.grids[g].scale, spec.grids[g].channels // 4
        rows, columns = spec.cells(0, g)
        first = sum(int(np.prod(spec.cells(0, k))) * spec.grids[k].channels // 4 for k in range(g))
        first_kernel = sum(len(bilinear(grid)) for grid in spec.grids[:g])
        input = sum(grid.channels for grid in spec.grids[:g])

        @wp.func
        def features(read: wp.array[wp.vec4], kernels: wp.array[wp.vec4], i: int, j: int) -> vec_in:
            x = before(read, kernels, i, j)
            row, column = i / scale, j / scale
            for v in range(vectors):
                kernel = first_kernel + ((v * scale + i - row * scale) * scale + j - column * scale) * 4
                total = wp.vec4()
                for tap in range(4):  # own cell, right, below, right and below; at the edge the other side's
                    cell = (row + tap / 2) % rows * columns + (column + tap % 2) % columns
                    total += wp.cw_mul(kernels[kernel + tap], read[first + cell * vectors + v])
                for c in range(4):
                    x[input + 4 * v + c] = total[c]
            return x

        return features

    @wp.func
    def features(read: wp.array[wp.vec4], kernels: wp.array[wp.vec4], i: int, j: int) -> vec_in:
        return vec_in()

    for g in range(len(spec.grids)):
        features = with_grid(features, g)
    return features


def make_loss_kernel(texture: Texture) -> wp.Kernel:
    """The squared errors of random texels."""
    net, features = texture.net, make_features(texture.spec, texture.net.vec_in)
    vec_out, channels = net.vec_out, float(net.n_out)

    @wp.kernel(module="unique")
    def loss_kernel(
        params: net.Params,
        read: wp.array[wp.vec4],
        kernels: wp.array[wp.vec4],
        target: wp.array2d[vec_out],
        seed: wp.uint64,
        steps: wp.array[int],
        loss: wp.array[float],
    ):
        n = wp.tid()
        u = wn.random.uniform(wn.random.stream(seed, steps[0], n), 0)
        i, j = int(u[0] * float(target.shape[0])), int(u[1] * float(target.shape[1]))
        error = net.func(params, features(read, kernels, i, j)) - target[i, j]
        loss[n] = wp.dot(error, error) / channels

    return loss_kernel


def train(
    config: Config,
    name: str,
    texture: Texture,
    see: Callable[[wp.array], None] | None = None,
    add: Callable[[wp.array], None] | None = None,
) -> None:
    """see: called before a step with the number of steps, writes what the network sees of the latents into
    `texture.read`. add: adds to the gradient of the latents."""
    device, (steps, batch) = texture.device, config.effort(texture.device)
    target = wp.array(texture.target.values, dtype=texture.net.vec_out, device=device)
    loss_kernel, loss = make_loss_kernel(texture), wp.empty(batch, dtype=float, device=device)
    mean = wp.full(batch, value=1.0 / batch, dtype=float, device=device)  # d mean loss / d loss
    learned = {texture.parameters: 20 * config.rate, texture.net.master: config.rate}
    kernels, trains_kernels = texture.kernels["kernels"], texture.spec.grids[0].kernel == "learned"
    if trains_kernels:
        learned[texture.kernels] = config.rate
    optimizers = [Adam(p, lr=cosine(r, r / 50, steps), beta2=0.99, clear=True) for p, r in learned.items()]
    count, read = optimizers[0].steps, texture.read
    inputs = [texture.net.params, read, kernels, target, config.seed, count]
    gradients = [texture.net.params, read.grad, kernels.grad if trains_kernels else None, None, None, None]
    for _ in cli.progress(range(steps), config, desc=name):
        see(count) if see else wp.copy(read, texture.latents)
        # the adjoint kernel runs the forward part itself
        wp.launch(
            loss_kernel, dim=loss.shape, inputs=inputs, outputs=[loss], adjoint=True,
            adj_inputs=gradients, adj_outputs=[mean], device=device,
        )  # fmt: skip
        if add:
            add(count)
        for optimizer in optimizers:
            optimizer.step()
        texture.net.pack()


def fit(config: Config, name: str, target: TextureSet, grids: tuple[Grid, ...]) -> list[Point]:
    """Train once, round to each of `BITS`."""
    texture = Texture(grids, target, config.seed, cli.resolve_device(config.device))
    train(config, name, texture)
    latents = 4 * sum(texture.vectors)
    return [texture.point(texture.rounded(bits), bits * latents, bits_of_latent=bits) for bits in BITS]


def curve(config: Config, target: TextureSet) -> list[Point]:
    return fit(config, "step_01", target, GRIDS)


def main(config: Config) -> dict:
    return report(config, "step_01", curve)


if __name__ == "__main__":
    cli.run(main, Config)
