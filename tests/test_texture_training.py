"""A training step of a neural texture against the float64 reference, and what a run keeps."""

import numpy as np
import pytest
import reference_networks as networks
import reference_texture as reference
import warp as wp

from warp_neural.kernels.texture.levels import TILE
from warp_neural.kernels.texture.rate import laplace_bits
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.texture.decoder import Decoder
from warp_neural.texture.levels import COARSER, all_tiles, first_latents, split_latents, tile_order
from warp_neural.texture.state import Map
from warp_neural.texture.trainer import TextureTrainer

GRIDS = Grid(2, 5), Grid(4, 6, "separable"), Grid(8, 3, "bilinear", bits=4)
SIZES = [(64, 32, 1), (40, 72, 2), (17, 5, 3), (1, 1, 1)]


def make(height=64, width=32, mips=1, grids=GRIDS, channels=3, device="cpu", **options):
    spec = TextureSpec(height, width, channels, mips, grids, hidden=(16, 16))
    random = np.random.default_rng(3)
    levels = [random.random((*spec.size(mip), channels), np.float32) for mip in range(mips)]
    options = {"rate_weight": 1e-3, "steps": 100, "tiles": 4} | options
    return TextureTrainer(spec, levels, device=device, **options), levels


def maps_of(channels):
    return (Map("all", "linear", (0.0,) * channels, (1.0,) * channels),)


def tensors_of(trainer):
    """What the trainer has now, float64, by the file's names."""
    state = trainer.state(maps_of(trainer.spec.channels))
    tensors = {}
    for name, place in trainer.layout.places.items():
        if name.startswith("kernel"):
            values = trainer.data.kernels.numpy()[place.start : place.end].reshape(place.shape)
            tensors[name] = np.float64(np.moveaxis(values, -1, 0))
    for l, (w, b) in enumerate(zip(trainer.net.weights, trainer.net.biases, strict=True)):
        tensors |= {f"weights_{l}": np.float64(w), f"biases_{l}": np.float64(b)}
    assert tensors.keys() == state.tensors.keys()
    return tensors


def step_without_update(trainer):
    """Rounded latents, and the gradients that one step adds up."""
    trainer.data.noise_until = 0
    trainer.launches.gradient(0)
    return trainer.data.gradient.numpy(), trainer.data.kernels_gradient.numpy()


@pytest.mark.parametrize(("height", "width", "mips"), SIZES, ids=str)
def test_inputs(height, width, mips, device):
    """Of the texels of each tile, as the network reads them."""
    trainer, _ = make(height, width, mips, device=device)
    trainer.data.latents.assign(4 * trainer.data.latents.numpy())
    trainer.data.noise_until = 0
    trainer.batch.encode([None, trainer.data, trainer.progress])
    encoded = trainer.batch.values.numpy().astype(np.float64).reshape(-1, TILE, TILE, trainer.spec.n_in)
    latents, tensors = trainer.state(maps_of(3)).latents, tensors_of(trainer)
    for tile, (mip, row, column) in zip(encoded, trainer.data.tiles.numpy(), strict=False):
        x = reference.inputs(trainer.spec, latents[mip], tensors, mip)
        rows, columns = (np.arange(TILE)[:, None] + row) % x.shape[0], (np.arange(TILE) + column) % x.shape[1]
        np.testing.assert_allclose(tile, x[rows, columns], rtol=2e-3, atol=2e-3)


@pytest.mark.parametrize(("height", "width", "mips"), SIZES, ids=str)
def test_gradients(height, width, mips, device):
    """Of the squared error and the bits, to latents, kernels and network."""
    trainer, levels = make(height, width, mips, rate_weight=0.5, device=device)
    spec, scale = trainer.spec, float(trainer.progress.scale.numpy()[0])
    weight = trainer.data.rate_weight.numpy()[0]
    latents, tensors = trainer.state(maps_of(3)).latents, tensors_of(trainer)
    to_latents, to_kernels = step_without_update(trainer)
    expected = [np.zeros((*spec.cells(m, g), grid.channels)) for m in range(mips) for g, grid in enumerate(spec.grids)]
    to_taps = [0.0] * len(spec.grids)
    weights = [tensors[f"weights_{l}"] for l in range(3)]
    biases = [tensors[f"biases_{l}"] for l in range(3)]
    activations = [networks.ACTIVATIONS[name] for name in ("elu", "elu", "linear")]
    loss = 0.0
    for mip, row, column in trainer.data.tiles.numpy()[: trainer.tiles]:
        x = reference.inputs(spec, latents[mip], tensors, mip)
        rows, columns = (np.arange(TILE)[:, None] + row) % x.shape[0], (np.arange(TILE) + column) % x.shape[1]
        tile_x = x[rows, columns].reshape(-1, spec.n_in)
        known = ((rows < spec.size(mip)[0]) & (columns < spec.size(mip)[1])).reshape(-1, 1)
        target = levels[mip][rows % spec.size(mip)[0], columns % spec.size(mip)[1]].reshape(-1, 3)
        y = networks.mlp(weights, biases, activations, tile_x)
        loss += (known * (y - target) ** 2).mean(1).sum()
        *_, dx = networks.mlp(weights, biases, activations, tile_x, known * 2 / 3 * (y - target))
        gradient = np.zeros_like(x)
        np.add.at(gradient, (rows, columns), dx.reshape(TILE, TILE, -1))
        first = 0
        for g, grid in enumerate(spec.grids):
            taps, part = reference.taps_of(grid, tensors, g), gradient[..., first : first + grid.channels]
            first += grid.channels
            q = np.float64(latents[mip][g])
            dq, dtaps = reference.features_adjoint(q, taps, part)
            cells = TILE // grid.scale
            r = (np.arange(cells)[:, None] + row // grid.scale) % q.shape[0]
            c = (np.arange(cells) + column // grid.scale) % q.shape[1]
            sigma, h = np.log(2) + 0.02, 1e-6  # scales start at 0
            slope = (reference.laplace_bits(q + h, sigma) - reference.laplace_bits(q - h, sigma)) / (2 * h)
            np.add.at(dq, (r, c), (COARSER if mip else 1) * weight * slope[r, c])
            expected[mip * len(spec.grids) + g] += dq
            to_taps[g] = to_taps[g] + dtaps
    for found, truth in zip(np.split(to_latents, first_latents(spec)[1:-1]), expected, strict=True):
        assert_near(found / scale, truth.ravel(), 2e-2)
    place = trainer.layout.places["kernel_0"]
    assert_near(to_kernels[place.start : place.end] / scale, to_taps[0].ravel(), 2e-2)
    (y, x), (grid_y, grid_x) = (
        (trainer.layout.places[f"kernel_1_{axis}"] for axis in "yx"),
        (tensors[f"kernel_1_{axis}"] for axis in "yx"),
    )
    per_tap = to_taps[1].reshape(4, 4, 2, 2, 6)
    assert_near(to_kernels[y.start : y.end] / scale, np.einsum("yxabc,cxb->yac", per_tap, grid_x).ravel(), 2e-2)
    assert_near(to_kernels[x.start : x.end] / scale, np.einsum("yxabc,cya->xbc", per_tap, grid_y).ravel(), 2e-2)


def assert_near(found, truth, bound):
    """Relative to the largest: the network rounds to 16 bits."""
    assert np.abs(found - truth).max() <= bound * max(np.abs(truth).max(), 1e-6)


@wp.kernel
def bits_kernel(q: wp.array[float], sigma: float, y: wp.array[wp.vec3]):
    i = wp.tid()
    y[i] = laplace_bits(q[i], sigma)


@pytest.mark.parametrize("sigma", [0.02, 0.3, 1.0, 20.0])
def test_bits(sigma, device):
    q = np.array([-40.0, -3.2, -0.7, -0.2, 0.0, 0.1, 0.4999, 0.5001, 1.0, 2.5, 9.0])
    y = wp.zeros(len(q), dtype=wp.vec3, device=device)
    wp.launch(bits_kernel, len(q), [wp.array(q, dtype=float, device=device), sigma, y], device=device)
    bits, in_q, in_sigma = y.numpy().T
    h = 1e-6
    np.testing.assert_allclose(bits, reference.laplace_bits(q, sigma), rtol=2e-5, atol=2e-6)
    slope = (reference.laplace_bits(q + h, sigma) - reference.laplace_bits(q - h, sigma)) / (2 * h)
    smooth = q != 0
    np.testing.assert_allclose(in_q[smooth], slope[smooth], rtol=2e-3, atol=2e-3)
    slope = (reference.laplace_bits(q, sigma + h) - reference.laplace_bits(q, sigma - h)) / (2 * h)
    np.testing.assert_allclose(in_sigma, slope, rtol=2e-3, atol=2e-3)


def test_tiles_cover_every_level():
    spec = TextureSpec(100, 40, 3, 3, GRIDS)
    order = tile_order(spec, 2 * all_tiles(spec), np.random.default_rng(0))
    for half in np.split(order, 2):
        for mip in range(3):
            rows, columns = (np.array(spec.cells(mip, 2)) * 8).tolist()
            seen = np.zeros((rows, columns), int)
            for _, row, column in half[half[:, 0] == mip]:
                r, c = (np.arange(TILE)[:, None] + row) % rows, (np.arange(TILE) + column) % columns
                seen[r, c] += 1
            assert seen.min() >= 1


def test_a_latent_moves_once_and_only_where_a_step_has_been(device):
    trainer, _ = make(256, 256, tiles=2, device=device)
    trainer.data.latents.assign(10 * trainer.data.latents.numpy())  # gradients far above Adam's epsilon
    before = trainer.data.latents.numpy().copy()
    trainer.run(1)
    after, first = trainer.data.latents.numpy(), trainer.data.first.numpy()
    moved = before != after
    assert 0.01 < moved.mean() < 0.2 and not first[~moved].any()
    # Adam's first step is the rate in the direction of the gradient
    np.testing.assert_allclose(np.abs(after - before)[moved], 0.3, rtol=1e-3)
    assert not trainer.data.gradient.numpy().any()


def test_learns(device):
    """A smooth picture, to what 8 bits show; few bits are left of its latents where bits cost much."""
    y, x = np.mgrid[:64, :64] / 64
    picture = np.stack([0.5 + 0.4 * np.sin(6.3 * x), 0.5 + 0.4 * np.cos(6.3 * y), x * 0 + 0.3], -1).astype(np.float32)
    results = []
    for weight in (1e-6, 3e-2):
        spec = TextureSpec(64, 64, 3, 1, GRIDS, hidden=(16, 16))
        trainer = TextureTrainer(spec, [picture], rate_weight=weight, steps=400, tiles=4, device=device)
        trainer.run()
        decoded = Decoder(trainer.state(maps_of(3)), device).decode()
        results.append((np.square(decoded - picture).mean(), trainer.bits))
    (good, many), (poor, few) = results
    assert good < 2e-4 and few < 0.2 * many and good < poor


def test_hidden_texels_may_be_anything(device):
    """NaN targets give no gradient."""
    trainer, levels = make(device=device)
    levels[0][...] = np.nan
    trainer, _ = make_of(trainer.spec, levels, device)
    trainer.data.rate_weight.zero_()
    to_latents, to_kernels = step_without_update(trainer)
    assert not to_latents.any() and not to_kernels.any()


def make_of(spec, levels, device):
    return TextureTrainer(spec, levels, rate_weight=1e-3, steps=100, tiles=4, device=device), levels


@pytest.mark.parametrize(("height", "width", "mips"), SIZES, ids=str)
def test_decoding(height, width, mips, device):
    trainer, _ = make(height, width, mips, device=device)
    trainer.run(20)
    state = trainer.state(maps_of(3))
    decoder = Decoder(state, device)
    tensors = {name: np.float64(tensor.values) for name, tensor in state.tensors.items()}
    for mip in range(mips):
        truth = reference.decode(trainer.spec, state.latents[mip], tensors, mip)
        np.testing.assert_allclose(decoder.decode(mip), truth, rtol=0, atol=6e-3)
    if height > 8:
        part = decoder.decode(0, (3, 2, width - 4, height - 5))
        bound = 0 if decoder.device.is_cpu else 1e-6  # on CUDA warps with lanes missing sum in another order
        np.testing.assert_allclose(part, decoder.decode(0)[2:-3, 3:-1], rtol=0, atol=bound)


def test_a_run_goes_on_from_what_it_was():
    """Bit for bit on the CPU, from noisy and from resting latents."""
    for stop in (30, 95):
        trainer, levels = make()
        trainer.run(stop)
        saved = trainer.snapshot()
        trainer.run()
        again, _ = make_of(trainer.spec, levels, "cpu")
        again.restore(saved)
        assert again.index == stop
        again.run()
        for name, array in trainer.arrays.items():
            np.testing.assert_array_equal(array.numpy(), again.arrays[name].numpy(), name)


def test_weights_end_on_the_files_steps():
    trainer, _ = make()
    trainer.run()
    state = trainer.state(maps_of(3))
    decoded = Decoder(state, "cpu").decode()
    used = trainer.data.kernels.numpy()[: trainer.layout.kernels_end]
    place = trainer.layout.places["kernel_0"]
    kernel = np.moveaxis(state.tensors["kernel_0"].values, 0, -1).ravel()
    np.testing.assert_allclose(used[place.start : place.end], kernel, rtol=1e-6)
    assert np.isfinite(decoded).all() and trainer.index == 100


def test_latents_split_by_level_and_grid():
    spec = TextureSpec(40, 72, 3, 2, GRIDS)
    flat = np.arange(first_latents(spec)[-1])
    parts = split_latents(spec, flat)
    assert [[x.shape for x in level] for level in parts] == [
        [(20, 36, 5), (10, 18, 6), (5, 9, 3)],
        [(12, 20, 5), (6, 10, 6), (3, 5, 3)],
    ]
    assert parts[0][0].ravel()[0] == 0 and parts[1][2].ravel()[-1] == flat[-1]
