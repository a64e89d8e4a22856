"""The neural texture in PyTorch: its loss against NumPy by the definitions, and the measurement at toy size."""

import numpy as np
import pytest

from perf import texture_torch
from warp_neural.errors import InputError
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.texture.trainer import TextureTrainer

GRIDS = (Grid(2, 3), Grid(4, 4), Grid(8, 2, "separable"), Grid(16, 2, "bilinear"))
SPEC = TextureSpec(64, 96, 5, 1, GRIDS, hidden=(16, 16))


@pytest.fixture
def texture():
    torch = pytest.importorskip("torch")
    from perf.texture_torch_model import Texture

    torch.manual_seed(0)
    values = np.random.default_rng(0).random((64, 96, 5), np.float32)
    return Texture(SPEC, values, 0.01).double()


def features(texture, latents: list[np.ndarray], i: int, j: int) -> np.ndarray:
    """Of one texel, by the definition."""
    found = []
    for g, (grid, q) in enumerate(zip(GRIDS, latents, strict=True)):
        kernel, s = texture.kernel(g).detach().numpy(), grid.scale
        taps = [q[(i // s + y) % q.shape[0], (j // s + x) % q.shape[1]] for y in (0, 1) for x in (0, 1)]
        found += list(sum(kernel[:, i % s, j % s, k] * tap for k, tap in enumerate(taps)))
    return np.array(found)


def test_texels(texture):
    """Without noise: the mean squared error of a network in NumPy, at a tile that wraps."""
    import torch

    corners = torch.tensor([[48, 80]])
    latents = [q.detach().numpy() for q in texture.latents]
    rows, columns = (48 + np.arange(32)) % 64, (80 + np.arange(32)) % 96
    x = np.array([features(texture, latents, i, j) for i in rows for j in columns])
    for k, layer in enumerate(texture.layers):
        x = x @ layer.weight.detach().numpy().T + layer.bias.detach().numpy()
        x = np.where(x > 0, x, np.expm1(np.minimum(x, 0))) if k < 2 else x
    target = texture.targets.numpy()[rows[:, None], columns[None]].reshape(-1, 5)
    noise = [(p - round_patch(texture, corners, g)).abs().max() for g, p in enumerate(texture.patches(corners))]
    assert all(0.4 < n <= 0.5 for n in noise[:3])
    patches = [round_patch(texture, corners, g) for g in range(4)]
    loss = float(texture.loss(patches, texture.target(corners)).detach())
    bits = float(texture.bits(patches).detach())
    assert loss == pytest.approx(np.square(x - target).mean() + 0.01 * bits / 1024, rel=1e-5)  # of float32 errors


def round_patch(texture, corners, g: int):
    """A grid's latents of the tiles, without noise."""
    from perf.texture_torch_model import around

    scale, latents = GRIDS[g].scale, texture.latents[g].detach()
    rows, columns = around(corners // scale, 32 // scale + 1, latents.shape)
    return latents[rows, columns]


def test_bits():
    """The masses of all whole numbers add up to 1, also from in between; bits against the difference of the CDF."""
    torch = pytest.importorskip("torch")
    from perf.texture_torch_model import FLOOR, laplace_bits

    sigma = torch.tensor([0.05, 0.7, 3.0], dtype=torch.float64)
    for shift in (0.0, 0.3, 0.5):
        q = (torch.arange(-60, 61, dtype=torch.float64) + shift)[:, None]
        mass = 2 ** -laplace_bits(q, sigma) - FLOOR
        np.testing.assert_allclose(mass.sum(0), 1, atol=1e-7)
    cdf = lambda x: np.where(x < 0, 0.5 * np.exp(np.minimum(x, 0) / 0.7), 1 - 0.5 * np.exp(-np.maximum(x, 0) / 0.7))  # noqa: E731
    q = np.linspace(-4, 4, 33)
    expected = -np.log2(cdf(q + 0.5) - cdf(q - 0.5) + FLOOR)
    np.testing.assert_allclose(laplace_bits(torch.from_numpy(q), sigma[1]), expected, rtol=1e-12)


def test_rate_reaches_latents_and_scales_everywhere(texture):
    import torch

    corners = torch.tensor([[0, 0], [16, 32]])
    with torch.no_grad():
        texture.latents[0][0, 0] = 1e4  # its mass is below the floor, its gradient 0 and not NaN
    texture.bits([round_patch(texture, corners, g).requires_grad_() for g in range(4)]).backward()
    assert all(torch.isfinite(s.grad).all() and (s.grad != 0).all() for s in texture.scales)


def test_loss_and_gradients_are_the_trainers():
    """Of the first step, with the trainer's own noise: latents, kernels, scales, network."""
    torch = pytest.importorskip("torch")
    from perf.texture_torch_model import Texture, around

    values = np.random.default_rng(0).random((64, 96, 5), np.float32)
    trainer = TextureTrainer(SPEC, [values], rate_weight=0.5, steps=2, tiles=2, device="cpu")
    texture = Texture(SPEC, values, float(trainer.data.rate_weight.numpy()[0]))
    places, kernels = trainer.layout.places, trainer.kernels.numpy()
    with torch.no_grad():
        for name, place in places.items():
            part = np.moveaxis(kernels[place.start : place.end].reshape(place.shape), -1, 0)
            target = texture.scales[int(name[-1])] if name.startswith("scale") else texture.kernels[name]
            target.copy_(torch.from_numpy(part.copy()))
        for layer, weights, biases in zip(texture.layers, trainer.net.weights, trainer.net.biases, strict=True):
            layer.weight.copy_(torch.from_numpy(weights.astype(np.float16).astype(np.float32)))
            layer.bias.copy_(torch.from_numpy(biases.copy()))
    trainer.launches.gradient(0)
    gradients, counted = trainer.data.kernels_gradient.numpy().copy(), 2 * 32 * 32
    sides = [32 // grid.scale + 1 for grid in GRIDS]
    noisy = [g.noisy.numpy().reshape(2, n, n, -1) for g, n in zip(trainer.batch.grids, sides, strict=True)]
    patches = [torch.from_numpy(each.copy()).requires_grad_() for each in noisy]
    corners = torch.from_numpy(trainer.data.tiles.numpy()[:2, 1:])
    loss = texture.loss(patches, texture.target(corners))
    loss.backward()
    found = np.concatenate([np.concatenate([l.weight.grad.ravel(), l.bias.grad]) for l in texture.layers])
    close(trainer.launches.gathered()[: len(found)] / counted, found)
    for name, kernel in texture.kernels.items():
        place = places[name]
        close(np.moveaxis(gradients[place.start : place.end].reshape(place.shape), -1, 0) / counted, kernel.grad)
    sums = trainer.data.sums.numpy().sum(0)  # of each channel: the derivative in sigma, bits
    slope = torch.sigmoid(torch.cat([*texture.scales])).detach().numpy()
    close(slope * sums[:, 0] / counted, torch.cat([scale.grad for scale in texture.scales]))
    close(sums[:, 1].sum(), texture.bits(patches).detach())
    latents, start = trainer.data.gradient.numpy() / counted, 0
    for grid, patch, shape in zip(GRIDS, patches, (q.shape for q in texture.latents), strict=True):
        expected = torch.zeros(shape)
        rows, columns = around(corners // grid.scale, patch.shape[1], shape)
        expected.index_put_((rows, columns), patch.grad, accumulate=True)
        close(latents[start : start + expected.numel()].reshape(shape), expected)
        start += expected.numel()


def close(found: np.ndarray, expected) -> None:
    """The trainer's network has numbers of 16 bits, rounded by up to 2^-12 of their size."""
    expected = np.asarray(expected)
    assert np.linalg.norm(found - expected) < 2**-12 * np.linalg.norm(expected)


def test_measurement(tmp_path):
    pytest.importorskip("torch")
    options = {"side": 64, "tiles": 1, "rounds": 2, "quick": True, "device": "cpu", "json": True}
    metrics = texture_torch.main(texture_torch.TextureConfig(out=tmp_path, **options))
    rows = ("Warp Neural", "PyTorch eager, float32", "PyTorch eager, bfloat16")
    assert all(metrics[f"{row} / step"] > 0 for row in rows)


def test_without_pytorch(monkeypatch):
    monkeypatch.setattr(texture_torch, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="PyTorch: not installed"):
        texture_torch.main(texture_torch.TextureConfig(device="cpu"))
