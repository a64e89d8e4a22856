"""Latents in BC1 blocks: what a step reads and its gradients against float64 NumPy, and blocks by another decoder."""

import numpy as np
import pytest
import warp as wp
from reference_blocks import decoded, line

from warp_neural import InputError
from warp_neural.kernels.texture.block_latents import PARAMETERS
from warp_neural.kernels.texture.levels import TILE
from warp_neural.kernels.texture.spec import BlockSpec
from warp_neural.texture.block_trainer import BlockTrainer
from warp_neural.texture.state import Map

SIZES = [(64, 32, 1, (1, 2)), (48, 80, 2, (1, 2, 4)), (24, 8, 5, (2, 1))]
STEPS = np.array([31, 63, 31] * 2 + [3] * 16)


def make(height, width, mips, scales, device, **options):
    spec = BlockSpec(height, width, 3, mips, scales, hidden=(16, 16))
    i, j = np.mgrid[:height, :width]
    picture = 0.5 + 0.3 * np.stack([np.sin(i / 4), np.cos(j / 3), np.sin((i + j) / 5)], -1)
    levels = [picture[: spec.size(mip)[0], : spec.size(mip)[1]].astype(np.float32) for mip in range(mips)]
    trainer = BlockTrainer(spec, levels, device=device, **({"steps": 100, "tiles": 4} | options))
    random = np.random.default_rng(9)
    for grid in trainer.batch.grids:
        blocks = grid.levels.blocks
        parameters = random.random((blocks, PARAMETERS)) * STEPS
        parameters[::5, 3:6] = parameters[::5, :3]  # equal ends
        grid.data.parameters.assign(parameters.astype(np.float32))
    trainer.data.noise_until = 0
    return trainer


def maps_of(channels):
    return (Map("all", "linear", (0.0,) * channels, (1.0,) * channels),)


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_inputs_are_what_another_decoder_and_a_bilinear_filter_give(size, device):
    trainer = make(*size, device)
    spec, blocks = trainer.spec, trainer.state(maps_of(3)).blocks
    trainer.batch.encode([None, trainer.data, trainer.progress])
    encoded = trainer.batch.values.numpy().astype(np.float64).reshape(-1, TILE, TILE, spec.n_in)
    for tile, (mip, row, column) in zip(encoded, trainer.data.tiles.numpy(), strict=False):
        height, width = spec.size(mip)
        rows, columns = (np.arange(TILE)[:, None] + row) % height, (np.arange(TILE) + column) % width
        for g in range(len(spec.scales)):
            codes = decoded(spec, blocks, g, mip)
            x = np.einsum("ya,abc,xb->yxc", line(height, codes.shape[0]), codes, line(width, codes.shape[1]))
            expected = 4 * (x / 255 - 0.5)
            np.testing.assert_allclose(tile[..., 3 * g : 3 * g + 3], expected[rows, columns], atol=2e-3)  # float16
        if spec.mips > 1:
            np.testing.assert_array_equal(tile[..., -1], mip / 8)


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_gradients(size, device):
    """Of any gradient to the inputs, to ends and indices, straight through their rounding."""
    trainer = make(*size, device)
    spec, random = trainer.spec, np.random.default_rng(2)
    trainer.batch.encode([None, trainer.data, trainer.progress])
    given = random.integers(-8, 9, trainer.batch.values.shape) / 8  # float16 has these exactly
    trainer.batch.values.assign(given.astype(trainer.batch.values.numpy().dtype))
    trainer.batch.adjoint([None, trainer.data, trainer.progress])
    given = given.reshape(-1, TILE, TILE, spec.n_in)
    for g, grid in enumerate(trainer.batch.grids):
        parameters = np.rint(grid.data.parameters.numpy().reshape(-1, PARAMETERS).astype(np.float64))
        expected = np.zeros_like(parameters)
        for mip in range(spec.mips):
            height, width = spec.size(mip)
            rows, columns = spec.latents(mip, g)
            by_texel = np.zeros((height, width, 3))
            for tile, place in zip(given, trainer.data.tiles.numpy(), strict=False):
                if place[0] == mip:
                    at = (np.arange(TILE)[:, None] + place[1]) % height, (np.arange(TILE) + place[2]) % width
                    np.add.at(by_texel, at, tile[..., 3 * g : 3 * g + 3])
            by_value = 4 * np.einsum("ya,yxc,xb->abc", line(height, rows), by_texel, line(width, columns))
            i, j = np.mgrid[:rows, :columns]
            block = grid.levels.starts[mip] + i // 4 * -(-columns // 4) + j // 4
            first, second = (parameters[block, k : k + 3] / STEPS[:3] for k in (0, 3))
            index = 6 + i % 4 * 4 + j % 4
            share = parameters[block, index][..., None] / 3
            np.add.at(expected, (block, index), (by_value * (second - first)).sum(-1) / 3)
            for c in range(3):
                np.add.at(expected, (block, c), (by_value * (1 - share))[..., c] / STEPS[c])
                np.add.at(expected, (block, 3 + c), (by_value * share)[..., c] / STEPS[c])
        found = grid.data.gradient.numpy().reshape(-1, PARAMETERS)
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)  # sums of float32


def test_training_and_going_on(device):
    trainer = make(32, 32, 1, (1, 2), device, steps=300)
    trainer.data.noise_until = trainer.schedule.noise_until
    trainer.run(64)
    early, kept = trainer.loss, trainer.snapshot()
    trainer.run()
    assert trainer.loss < early / 4
    state = trainer.state(maps_of(3))
    again = make(32, 32, 1, (1, 2), device, steps=300)
    again.data.noise_until = again.schedule.noise_until
    again.restore(kept)
    again.run()
    if not wp.get_device(device).is_cuda:  # atomics add in any order there
        other = again.state(maps_of(3))
        assert all((a[0] == b[0]).all() for a, b in zip(state.blocks, other.blocks, strict=True))


def test_bits_and_bad_sizes():
    assert BlockSpec(64, 64, 3, 1, (1, 1, 2, 2)).resident_bits == 10
    assert BlockSpec(64, 64, 3, 1, (2,) * 5).resident_bits == 5
    with pytest.raises(InputError, match="multiples of 8; resize"):
        BlockSpec(63, 64, 3, 1, (2,))
    with pytest.raises(InputError, match="1, 2, 4 or 8"):
        BlockSpec(64, 64, 3, 1, (3,))
