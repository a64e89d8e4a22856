"""The format of `.wntc` files: another reader has the same, version 1 is read for ever, contexts save bits."""

import zlib
from pathlib import Path

import numpy as np
import pytest
import reference_wntc
import warp as wp
from wntc_states import E24, SMALL, golden_spec, make_state

from warp_neural.kernels.texture import coding
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.texture.contexts import NEAR, UNIT
from warp_neural.texture.file import TextureFile, load_state, save_state, to_bytes
from warp_neural.texture.tables import SCALES, gauss, laplace

GOLDEN = Path(__file__).parent / "golden" / "version_1.wntc"
GOLDEN_CRCS = 0x07251E95, 0xA067B128, 0x256B8268  # latents, integers and steps of the tensors
BITS = (Grid(1, 1, "bilinear", 1), Grid(2, 9, "separable", 4), Grid(8, 2, "learned", 7))


@pytest.mark.parametrize(
    "spec", [golden_spec(), TextureSpec(40, 70, 3, 2, BITS, (3, 4)), TextureSpec(9, 300, 1, 1, E24)]
)
def test_another_reader_has_the_same(spec):
    state = make_state(spec, seed=3, extra={"a": [1]})
    other = reference_wntc.read(to_bytes(state))
    for mip in range(spec.mips):
        assert all((other["latents"][mip, g] == q).all() for g, q in enumerate(state.latents[mip]))
    for name, step, integers in zip(spec.tensors, other["steps"], other["tensors"], strict=True):
        assert step == state.tensors[name].step and (integers == state.tensors[name].integers).all()
    assert other["extra"] == state.extra and [each[0] for each in other["maps"]] == [each.name for each in state.maps]


def test_version_1_is_read_for_ever(device):
    """Never write this file again: a change that fails here is a new version, beside which this one is still read."""
    state = load_state(GOLDEN, device)
    assert state.spec == golden_spec() and state.extra == {"version": 1}
    assert [each.name for each in state.maps] == [*(f"map {c}" for c in range(5)), "flat"]
    latents = zlib.crc32(b"".join(grid.tobytes() for level in state.latents for grid in level))
    tensors = zlib.crc32(b"".join(state.tensors[name].integers.astype("<i4").tobytes() for name in state.spec.tensors))
    steps = zlib.crc32(np.array([state.tensors[name].step for name in state.spec.tensors], "<f2").tobytes())
    assert (latents, tensors, steps) == GOLDEN_CRCS


def test_tables_are_those_of_the_document():
    tables = [laplace(which, phase)[1:] for which in range(SCALES) for phase in range(5)]
    assert zlib.crc32(b"".join(np.array(table, "<u2").tobytes() for table in tables)) == 0x71E2D9D4
    assert "0x71E2D9D4" in (GOLDEN.parents[2] / "docs" / "wntc.md").read_text()
    for which in range(0, SCALES, 5):
        table = np.array([-1, *gauss(which)[1:]])
        assert (np.diff(table) > 0).all() and table[-1] == 65535 and table[-1] - table[-2] >= 16


def entropy(file, latents, g):
    """Bits of a grid of mip 0 under its context in floats, of a Laplace distribution without tables."""
    context, side = file.contexts[g], file.blocks.side(g)
    q = latents[g][..., context.channels].astype(float)
    rows, columns, n = q.shape
    lanes = context.integers.reshape(-1, -(-n // 8) * 8)[:, :n] / UNIT
    scale, mean, (y, x) = lanes[0] + 0 * q, lanes[1] + 0 * q, np.mgrid[:rows, :columns]
    for k, (dy, dx) in enumerate(NEAR):
        i, j = y + dy, x + dx
        inside = (i // side == y // side) & (j // side == x // side) & (i >= 0) & (j >= 0) & (j < columns)
        near = q[np.where(inside, i, 0), np.where(inside, j, 0)] * inside[..., None]
        scale, mean = scale + lanes[2 + k] * abs(near), mean + lanes[8 + k] * near
    scale, mean = scale + abs(q) @ lanes[14 : 14 + n], mean + q @ lanes[14 + n : 14 + 2 * n]
    if g + 1 < len(latents):
        above = abs(latents[g + 1][..., file.contexts[g + 1].channels].astype(float))
        above = sum(np.roll(above, (-i, -j), (0, 1)) for i in (0, 1) for j in (0, 1))
        ratio = rows // above.shape[0]
        scale = scale + above.repeat(ratio, 0).repeat(ratio, 1) @ lanes[14 + 2 * n :]
    scale, distance = np.maximum(scale, 1 / 64), abs(q - mean)
    inner, outer = np.exp(-abs(distance - 0.5) / scale), np.exp(-(distance + 0.5) / scale)
    mass = np.where(distance > 0.5, inner - outer, 2 - inner - outer) / 2
    return -np.log2(np.maximum(mass, 2.0**-20)).sum()


def test_streams_have_the_bits_of_their_contexts(tmp_path):
    state = make_state(TextureSpec(256, 256, 3, 1, E24))
    sizes = save_state(tmp_path / "a.wntc", state)
    file = TextureFile(tmp_path / "a.wntc")
    for g, size in enumerate(sizes["latents"][0]):  # one block each: its stream ends with up to four bytes more
        assert 0.99 < (8 * size - 32) / entropy(file, state.latents[0], g) < 1.01


def test_contexts_save_bits(tmp_path):
    """Of latents whose neighbours are alike, against the entropy of each channel alone."""
    state = make_state(TextureSpec(512, 512, 3, 1, SMALL))
    sizes, bits = save_state(tmp_path / "a.wntc", state), 0
    for grid in state.latents[0]:
        for channel in np.moveaxis(grid, 2, 0):
            shares = np.unique(channel, return_counts=True)[1] / channel.size
            bits -= channel.size * (shares * np.log2(shares)).sum()
    assert 8 * (sum(sizes["latents"][0]) + sizes["contexts"]) < 0.95 * bits


@pytest.mark.parametrize("arch", [75, 90])
def test_decoding_compiles_for_cuda(arch, tmp_path):
    (artifact,) = wp.compile_aot_module(coding.decode_blocks_kernel().module, arch=arch, module_dir=tmp_path)
    assert artifact.stat().st_size > 0
