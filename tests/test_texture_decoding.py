"""Whole pictures: on tensor cores what the kernel reads, its text, results; on the CPU by rows."""

import shutil

import emulated_warp
import numpy as np
import pytest
import reference_texture as reference
import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.nn.activations import elu
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.kernels.texture.tensor_cores import make_tensor_decode_kernel, tensor_dim, tile_text
from warp_neural.kernels.texture.tensor_layout import TensorLayout
from warp_neural.kernels.texture.texel import make_params_type
from warp_neural.nn.mlp import MLP
from warp_neural.texture import rows
from warp_neural.texture.decoder import Decoder
from warp_neural.texture.state import Map, Tensor, TextureState
from warp_neural.texture.tensor_cores import TensorDecoder

GRIDS = Grid(2, 10, bits=1), Grid(4, 7), Grid(8, 20, "separable", bits=4), Grid(16, 9, "bilinear", bits=2)
SPEC = TextureSpec(40, 52, 10, 2, GRIDS, (64, 64))


def make_state(spec, seed=0):
    rng = np.random.default_rng(seed)
    maps = (Map("albedo", "linear", (0.0,) * spec.channels, (1.0,) * spec.channels),)
    latents = tuple(
        tuple(latents_of(grid, spec.cells(mip, g), rng) for g, grid in enumerate(spec.grids))
        for mip in range(spec.mips)
    )
    tensors = {name: Tensor(rng.integers(-40, 41, shape), 0.005) for name, shape in spec.tensors.items()}
    return TextureState(spec, latents, tensors, maps)


def latents_of(grid, cells, rng):
    latents = rng.integers(-grid.limit, grid.limit + 1, (*cells, grid.channels)).astype(np.int8)
    return np.where(latents < 0, -1, 1).astype(np.int8) if grid.bits == 1 else latents // max(grid.limit // 3, 1)


def truth(state, mip):
    tensors = {name: np.float64(tensor.values) for name, tensor in state.tensors.items()}
    return reference.decode(state.spec, state.latents[mip], tensors, mip)


def test_tables_and_weights_give_the_texture():
    """In the order that the kernel reads them, by float64."""
    state, mip = make_state(SPEC), 1
    decoder = Decoder(state, "cpu")
    tensor = TensorDecoder(SPEC, decoder.Params, decoder.params, decoder.net)
    layout, x = tensor.layout, features_by_tables(tensor, state, mip)
    packed = tensor.weights.numpy().view(np.float16).astype(np.float64)
    biases, log2e = np.float64(tensor.biases.numpy().reshape(SPEC.mips, -1)[mip]), 1 / np.log(2)
    for l in range(3):
        x = x @ matrix_of(layout, packed, l).T + biases[2 * layout.biases[l] : 2 * layout.biases[l + 1]]
        x = np.where(x > 0, x, (2 ** np.minimum(x, 0) - 1) * log2e) if l < 2 else x
    height, width = SPEC.size(mip)
    error = x[:height, :width, : SPEC.channels] - truth(state, mip)
    assert np.sqrt(np.mean(error**2)) < 4e-3 * truth(state, mip).std()


def features_by_tables(tensor, state, mip):
    layout, x = tensor.layout, []
    tables = tensor.tables.numpy().astype(np.float64)
    for g, grid in enumerate(GRIDS):
        blocks, slabs = grid.scale // 2, layout.slabs[g]
        table = tables[8 * layout.tables[g] : 8 * layout.tables[g + 1]].reshape(slabs, 2, 2, blocks, blocks, 4, 4, 2)
        weights = table.transpose(3, 1, 4, 2, 6, 0, 5, 7).reshape(grid.scale, grid.scale, 4, -1)  # y, x, tap, channel
        assert not weights[..., grid.channels :].any()
        padded = np.pad(np.float64(state.latents[mip][g]), ((0, 0), (0, 0), (0, -grid.channels % 8)))
        x.append(reference.features(padded, weights))
    x = np.concatenate(x, -1)
    return np.pad(x, ((0, 0), (0, 0), (0, layout.sizes[0] - x.shape[-1])))


def matrix_of(layout, packed, l):
    """[outputs, inputs], from the order of lanes."""
    n_in, n_out = layout.sizes[l : l + 2]
    part = packed[256 * layout.weights[l] : 256 * layout.weights[l + 1]]
    lanes = part.reshape(n_in // 16, n_out // 16, 8, 4, 2, 2, 2)  # blocks, pairs, g, t, tile, half, column
    return lanes.transpose(1, 4, 2, 0, 5, 3, 6).reshape(n_out, n_in)


@pytest.mark.parametrize("dtype", [wp.float32, wp.float16, wp.uint8])
@pytest.mark.parametrize("arch", [75, 80, 90])
def test_compiles(arch, dtype, tmp_path):
    """For older ones the kernel is empty, and `can_decode` says so."""
    spec = TextureSpec(40, 52, 9 if dtype is wp.float32 else 10, 2, GRIDS, (64, 64))
    net = MLP(spec.n_in, spec.channels, 64, 1, activation=elu, device="cpu")
    kernel = make_tensor_decode_kernel(TensorLayout(spec), make_params_type(net.Params), dtype)
    (artifact,) = wp.compile_aot_module(kernel.module, arch=arch, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


def test_launches_fit():
    """The kernel takes its arguments; on the CPU it does nothing."""
    decoder = Decoder(make_state(SPEC), "cpu")
    tensor = TensorDecoder(SPEC, decoder.Params, decoder.params, decoder.net)
    values = wp.full((8, 9, 10), 7.0, dtype=float, device="cpu")
    tensor.decode(0, (3, 2, 9, 8), values)
    assert (values.numpy() == 7).all()


def test_tiles_cover_rectangles():
    assert tensor_dim(0, 0, 64, 64) == 32 * 8 * 16
    assert tensor_dim(7, 3, 2, 2) == 32 * 4 and tensor_dim(8, 4, 8, 4) == 128


def test_which_textures_fit():
    assert TensorLayout(SPEC).fits
    assert not TensorLayout(TextureSpec(8, 8, 3, 1, (Grid(1, 4), Grid(4, 4)))).fits
    assert not TensorLayout(TextureSpec(8, 8, 3, 1, (Grid(4, 4),), (96, 96))).fits


@pytest.mark.parametrize("channels", [3, 8, 10])
@pytest.mark.parametrize("dtype", [wp.float32, wp.float16, wp.uint8])
def test_decoded_into_arrays(device, channels, dtype):
    spec = TextureSpec(40, 52, channels, 2, GRIDS, (64, 64))
    state = make_state(spec)
    decoder = Decoder(state, device)
    values = wp.empty((11, 29, channels), dtype=dtype, device=device)
    if device.is_cpu and dtype is not wp.float32:
        with pytest.raises(InputError, match=r"results are \(11, 29, \d+\), of one of float32, contiguous on cpu"):
            decoder.decode_to(values, 0, (13, 22, 29, 11))
        return
    decoder.decode_to(values, 0, (13, 22, 29, 11))
    expected, result = truth(state, 0)[22:33, 13:42], values.numpy().astype(np.float64)
    if dtype is wp.uint8:
        expected, result = np.clip(expected, 0, 1), result / 255
    np.testing.assert_allclose(result, expected, atol=8e-3)
    np.testing.assert_allclose(decoder.decode(1), truth(state, 1), atol=8e-3)


def test_arrays_of_other_shapes_are_refused(device):
    decoder = Decoder(make_state(SPEC), device)
    with pytest.raises(InputError, match=r"results are \(40, 52, 10\)"):
        decoder.decode_to(wp.empty((40, 52, 3), dtype=float, device=device))


def test_threads_on_the_cpu_give_equal_results(monkeypatch):
    """Each row by one thread or another; results are those of single texels but for the order of sums."""
    spec = TextureSpec(150, 131, 5, 2, GRIDS, (32, 32))
    decoder = Decoder(make_state(spec), "cpu")
    monkeypatch.setattr(rows.os, "cpu_count", lambda: 1)
    alone = decoder.decode()
    monkeypatch.setattr(rows, "ENOUGH", 64)
    for cores in (3, 64):
        monkeypatch.setattr(rows.os, "cpu_count", lambda: cores)  # noqa: B023
        np.testing.assert_array_equal(decoder.decode(), alone)
        np.testing.assert_array_equal(decoder.decode(0, (37, 11, 90, 121)), alone[11:132, 37:127])
    values = wp.zeros((150, 131, 5), dtype=float, device="cpu")
    decoder.decode_alone(0, (0, 0, 131, 150), values)
    np.testing.assert_allclose(alone, values.numpy(), atol=4e-3)  # roundings to float16 differ


ODD = Grid(2, 5, bits=2), Grid(4, 7), Grid(8, 9, "separable", bits=3), Grid(16, 11, "bilinear", bits=1)
WHOLE = Grid(4, 16, bits=4), Grid(8, 24)  # cells of whole words


@pytest.mark.skipif(not shutil.which("g++"), reason="no g++ to run CUDA text with")
@pytest.mark.parametrize("grids, channels", [(GRIDS, 10), (ODD, 9), (WHOLE, 3)])
def test_the_kernel_on_a_warp_of_the_host(grids, channels, tmp_path):
    """Lanes, fragments, latents of all formats, edges that wrap and rectangles, as on a GPU."""
    state = make_state(TextureSpec(24, 40, channels, 2, grids, (64, 64)))
    decoder = Decoder(state, "cpu")
    tensor = TensorDecoder(state.spec, decoder.Params, decoder.params, decoder.net)
    values = emulated_warp.decode(tensor, tile_text(tensor.layout, wp.float32), tmp_path, 0, (5, 3, 35, 20))
    expected = truth(state, 0)[3:23, 5:40]
    assert np.sqrt(np.mean((values - expected) ** 2)) < 2e-3 * expected.std()
