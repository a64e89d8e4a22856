"""Every CUDA kernel compiles ahead of time for Hopper; this needs no GPU."""

import importlib

import numpy as np
import pytest
import warp as wp
from render_materials import Glossy

from warp_neural import encodings
from warp_neural.kernels.coopvec.convert import convert_kernel
from warp_neural.kernels.coopvec.network import make_network
from warp_neural.kernels.coopvec.operations import Buffer, MatrixSpec, make_matmul_add, make_outer_product_accumulate
from warp_neural.kernels.nn.losses import l2
from warp_neural.kernels.nn.optimizers import adam
from warp_neural.kernels.nn.random import Stream, uniform
from warp_neural.kernels.nn.spec import E4M3, FLOAT16, FLOAT32, INT8, NetworkSpec, Parameters
from warp_neural.kernels.render.path import make_path_kernel
from warp_neural.kernels.texture.spec import Grid
from warp_neural.kernels.training.encoded_batch import (
    make_adjoint_sample,
    make_encode_sample,
    make_encoded_kernel,
    make_shared_sums_kernel,
)
from warp_neural.kernels.training.fused import make_gradient_kernel
from warp_neural.kernels.training.mma.schedule import make_schedule
from warp_neural.kernels.training.taped_update import make_update_kernel
from warp_neural.kernels.training.update import make_fused_update_kernel
from warp_neural.materials.default_material import default_material
from warp_neural.render.materials import Diffuse, combine, functions_of
from warp_neural.render.textured import Textured
from warp_neural.samples.neural_texture.step_01_latent_texture import make_loss_kernel
from warp_neural.samples.neural_texture.texture import Texture
from warp_neural.samples.textured_scene.fetch import fetch_picture, vec7
from warp_neural.samples.textured_scene.scene import make_render_kernel
from warp_neural.texture.maps import TextureSet
from warp_neural.texture.state import Map

MODULES = [
    "warp_neural.kernels.render.film",
    "warp_neural.kernels.nn.optimizers",
    "warp_neural.kernels.shading.texture",
    "warp_neural.samples.mipmap.judge",
    "warp_neural.samples.mipmap.learn",
    "warp_neural.samples.mipmap.step_01_basic_program",
    "warp_neural.samples.mipmap.step_04_loss",
    "warp_neural.samples.mipmap.step_05_train",
    "warp_neural.samples.neural_texture.step_04_noise",
    "warp_neural.samples.neural_texture.step_05_straight_through",
    "warp_neural.samples.neural_texture.step_06_rate",
    "warp_neural.samples.neural_texture.step_07_context",
    "warp_neural.samples.textured_scene.scene",
    "warp_neural.samples.textured_scene.temporal",
]


@pytest.mark.parametrize("name", MODULES)
def test_compiles_for_hopper(name, tmp_path):
    importlib.import_module(name)
    (artifact,) = wp.compile_aot_module(name, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


def test_a_read_of_a_grid_compiles_for_hopper(tmp_path):
    maps, values = (Map("height", "linear", (0.0,), (1.0,)),), np.zeros((16, 16, 1), np.float32)
    texture = Texture((Grid(4, 4),), TextureSet("", maps, (values,)), 0, wp.get_device("cpu"))
    (artifact,) = wp.compile_aot_module(make_loss_kernel(texture).module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


def test_a_scene_compiles_for_hopper(tmp_path):
    kernel = make_render_kernel(fetch_picture, wp.array2d[vec7])
    (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


def test_paths_compile_for_hopper(tmp_path):
    """Through two sets of materials, one of them two again."""
    diffuse, textured = Diffuse([[0.5, 0.5, 0.5]], device="cpu"), Textured(default_material(8), device="cpu")
    materials = combine(Glossy([[0.5, 0.5, 0.5, 0.3, 0, 0.5]], "cpu"), combine(diffuse, textured))
    kernel = make_path_kernel(functions_of(materials))
    (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


@pytest.mark.parametrize("arch", [75, 80, 89, 90])
@pytest.mark.parametrize("format", [FLOAT32, FLOAT16, E4M3, INT8], ids=lambda format: format.name)
def test_networks_compile_for_every_architecture(format, arch, tmp_path):
    """Older ones lack the tensor-core instructions of some formats, `stmatrix` and vector reductions."""
    spec = NetworkSpec((20, 32, 32, 3), format=format)
    network, vec_in, vec_out = make_network(spec), spec.vec_in, spec.vec_out

    @wp.kernel(module="unique", enable_backward=format is FLOAT16)
    def kernel(params: Parameters, x: wp.array[vec_in], y: wp.array[vec_out]):
        i = wp.tid()
        y[i] = network(params, x[i])

    (artifact,) = wp.compile_aot_module(kernel.module, arch=arch, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


def test_conversion_compiles_for_hopper(tmp_path):
    (artifact,) = wp.compile_aot_module(convert_kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


def test_operations_compile_for_hopper(tmp_path):
    spec = MatrixSpec(20, 33, "float16")
    matmul_add, outer_product = make_matmul_add(spec), make_outer_product_accumulate(spec)
    vec_in, vec_out = spec.vec_in, spec.vec_out

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(x: wp.array[vec_in], matrix: Buffer, bias: Buffer, gradient: wp.array[float], y: wp.array[vec_out]):
        i = wp.tid()
        y[i] = matmul_add(x[i], matrix, 0, 0, bias, 0)
        outer_product(y[i], x[i], gradient, 0, 0)

    (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


@pytest.mark.parametrize("precision, dtype", [("int8", wp.int8), ("int8", wp.uint32), ("e5m2", wp.uint32)])
def test_packed_and_whole_numbers_compile_for_hopper(precision, dtype, tmp_path):
    spec = MatrixSpec(256, 33, precision, dtype=dtype)
    matmul_add, vec_in, vec_out = make_matmul_add(spec), spec.vec_in, spec.vec_out

    @wp.kernel(module="unique")
    def kernel(x: wp.array[vec_in], matrix: Buffer, bias: Buffer, y: wp.array[vec_out]):
        i = wp.tid()
        y[i] = matmul_add(x[i], matrix, 0, 0, bias, 0)

    (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


ENCODED = encodings.Concatenate((encodings.Identity(), encodings.LatentTexture(9, 9, 8)))


@wp.func
def corner(index: int, random: Stream):
    return wp.vec2(uniform(random, 0)[0], 0.5), wp.vec3(0.25)


@pytest.mark.parametrize("encoding", [None, encodings.Frequency(8), encodings.HashGrid(levels=8), ENCODED])
def test_training_compiles_for_hopper(encoding, tmp_path):
    spec = NetworkSpec((encoding.n_out(2) if encoding else 2, 64, 64, 3), accumulation="float16")
    encode, trains = encoding and encoding.make(2), encoding and encoding.make_adjoint(2)
    schedule = make_schedule(spec)
    kernels = [make_gradient_kernel(spec, schedule, corner, l2, None if trains else encode, trains is not None)]
    kernels.append(make_fused_update_kernel(adam, spec, schedule))
    if trains:
        leaf = encoding.leaves(2)[-1]
        which = leaf, wp.vec2, 4420, spec.format
        uses = make_encode_sample(*which), make_adjoint_sample(*which)
        kernels += [make_encoded_kernel(corner, use, leaf, spec.format) for use in uses]
        if leaf.encoding.shared_sums(2):
            kernels.append(make_shared_sums_kernel(corner, *which))
        kernels.append(make_update_kernel(adam))
    for kernel in kernels:
        (artifact,) = wp.compile_aot_module(kernel.module, arch=90, module_dir=tmp_path / kernel.key)
        assert artifact.stat().st_size > 0
