"""Every CUDA kernel of neural textures compiles ahead of time; this needs no GPU."""

from dataclasses import replace

import pytest
import warp as wp

from warp_neural.kernels.nn.activations import elu
from warp_neural.kernels.nn.optimizers import adam
from warp_neural.kernels.nn.spec import FLOAT16, NetworkSpec
from warp_neural.kernels.texture import (
    block_steps,
    block_texel,
    codes,
    features,
    filtering,
    filters,
    losses,
    rate,
    sample,
    texel,
    tiles,
    update,
)
from warp_neural.kernels.texture.spec import BlockSpec, Grid, TextureSpec
from warp_neural.kernels.training.fused import make_kernels
from warp_neural.kernels.training.rooms import choose_schedule
from warp_neural.kernels.training.update import make_fused_update_kernel
from warp_neural.nn.mlp import MLP

SPEC = TextureSpec(256, 256, 8, 3, (Grid(2, 12), Grid(8, 24, "separable"), Grid(16, 11, "bilinear")))


def compiles(kernel, arch, folder):
    (artifact,) = wp.compile_aot_module(kernel.module, arch=arch, module_dir=folder)
    assert artifact.stat().st_size > 0


@pytest.mark.parametrize("g", range(3))
def test_grids(g, tmp_path):
    half = wp.float16
    kernels = [features.make_disturb_kernel(SPEC, g), features.make_features_kernel(SPEC, g, half)]
    kernels += [features.make_adjoint_kernel(SPEC, g, half), rate.make_rate_kernel(SPEC, g)]
    kernels += [update.make_latents_kernel(SPEC, g)]
    kernels += [features.make_kernel_adjoint_kernel(SPEC, g, half)] if g < 2 else []
    for kernel in kernels:
        compiles(kernel, 90, tmp_path)


def test_network(tmp_path, monkeypatch):
    """By warpgroups, and updated in one launch."""
    monkeypatch.setattr(wp.config, "cuda_arch_suffix", "a")
    spec = NetworkSpec((SPEC.n_in, 64, 64, 8), elu, format=FLOAT16)
    schedule = choose_schedule(spec, 90, 227 * 1024)
    assert type(schedule).__name__ == "Hopper64Schedule"
    loss = replace(losses.known_l2, normals=(3,), colours=(0,))
    drawn = sample.make_sample(SPEC, 64, spec.vec_in)
    kernels = make_kernels(spec, schedule, drawn, loss, None, True, True)
    for kernel in [*kernels, make_fused_update_kernel(adam, spec, schedule), update.kernels_kernel]:
        compiles(kernel, 90, tmp_path)


def test_decoding_into_memory(tmp_path):
    """On load and on feedback."""
    net = MLP(SPEC.n_in, 8, 16, 1, activation=elu, device="cpu")
    params_type = texel.make_params_type(net.Params)
    each = texel.make_texel(SPEC, net.func, params_type)
    compiles(codes.make_fill_kernel(codes.Codes(8, 16), each, params_type), 90, tmp_path / "fill")
    compiles(tiles.make_decode_tiles_kernel(tiles.Tiles(8, 8, 64), each, params_type), 90, tmp_path / "tiles")


def functions(width, depth):
    """Stored texels, their exact filter, and the type of their parameters."""
    net = MLP(SPEC.n_in, 8, width, depth, activation=elu, device="cpu")
    params_type = texel.make_params_type(net.Params)
    each = texel.make_texel(SPEC, net.func, params_type)
    stored = texel.make_stored(each, ((0.0, 1.0, False),) * 7 + ((-4.0, 9.0, True),), params_type)
    return stored, filtering.make_sample(stored, SPEC, params_type), params_type


@pytest.mark.parametrize("arch", [75, 90])
def test_decoding(arch, tmp_path):
    _, blended, params_type = functions(64, 2)
    vec = wp.types.vector(8, float)

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(params: params_type, uv: wp.array[wp.vec2], y: wp.array[vec]):
        i = wp.tid()
        y[i] = blended(params, uv[i], 0.5)

    compiles(kernel, arch, tmp_path)


def test_stochastic_filters(tmp_path):
    stored, _, params_type = functions(64, 2)
    read = filtering.make_sampler(stored, filters.gaussian(0.5), SPEC, params_type)
    vec = wp.types.vector(8, float)

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(params: params_type, footprint: wp.mat22, random: wp.array[wp.vec4], y: wp.array[vec]):
        i = wp.tid()
        uv = wp.vec2(float(filters.bilinear(1.5, 0.25)), float(filters.bicubic(1.5, 0.25)))
        y[i] = read(params, uv, footprint, random[i])

    compiles(kernel, 90, tmp_path)


def test_gradients_of_filters(tmp_path):
    _, blended, params_type = functions(16, 1)
    vec = wp.types.vector(8, float)

    @wp.kernel(module="unique")
    def kernel(params: params_type, uv: wp.array[wp.vec2], y: wp.array[vec]):
        i = wp.tid()
        y[i] = blended(params, uv[i], 0.5)

    compiles(kernel, 90, tmp_path)


def test_blocks(tmp_path):
    half = wp.float16
    kernels = [block_steps.unblock_kernel, block_steps.make_block_features_kernel(half)]
    kernels += [block_steps.make_block_adjoint_kernel(half), block_steps.gradient_kernel]
    for kernel in [*kernels, block_steps.block_update_kernel]:
        compiles(kernel, 90, tmp_path)


def test_reading_blocks(tmp_path):
    """With gradients."""
    spec, vec = BlockSpec(256, 256, 8, 3, (1, 2, 2)), wp.types.vector(8, float)
    net = MLP(spec.n_in, 8, 64, 2, activation=elu, device="cpu")
    params_type = block_texel.make_block_params_type(net.Params)
    texel = block_texel.make_block_texel(spec, net.func, params_type)
    sample = block_texel.make_block_sample(spec, net.func, ((0.0, 1.0, False),) * 8, params_type)

    @wp.kernel(module="unique")
    def kernel(params: params_type, uv: wp.array[wp.vec2], y: wp.array[vec]):
        i = wp.tid()
        y[i] = texel(params, i, i, 1) + sample(params, uv[i], 0.5)

    compiles(kernel, 90, tmp_path)
