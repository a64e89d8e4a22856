"""Exported shaders, run: WGSL, GLSL and HLSL by glslang, Slang by slangc, through wgpu on a Vulkan driver."""

import numpy as np
import pytest
from engine_textures import make_state
from export_networks import CASES, cases

from warp_neural.errors import InputError
from warp_neural.export import export
from warp_neural.export.program import make_program
from warp_neural.export.shaders import SHADERS
from warp_neural.imaging.block_files import load_blocks
from warp_neural.kernels.nn import activations
from warp_neural.nn.mlp import MLP
from warp_neural.samples.deployment import webgpu
from warp_neural.texture.engine import EngineTexture

RUN_ON = [case for i, case in enumerate(CASES) if i % 2 == 0 or i >= 26]  # float32, all encodings
RUN_ON += [("elu", "float16"), ("gelu", "float16")]
EVERY = {"wgsl": 1, "glsl": 3, "hlsl": 4, "slang": 5}  # drivers take seconds to compile each
RUNS = [(language, *case) for language, step in EVERY.items() for case in RUN_ON[::step]]


@pytest.mark.parametrize(("language", "name", "precision"), RUNS)
def test_shaders_give_what_python_gives(language, name, precision, tmp_path):
    if lacking := webgpu.missing(language):
        pytest.skip(f"no {lacking}: .ci/tools says how to get it")
    (case, *_) = cases(name, precision)
    program = make_program(case.state)
    source = tmp_path / f"network.{SHADERS[language].suffix}"
    source.write_text(SHADERS[language]().source(program, "a test"))
    code = webgpu.compiled(language, source, tmp_path)
    found, _seconds = webgpu.evaluate(code, program.weights, case.inputs, program.n_out)
    limit = 1e-5 if precision == "float32" else 1e-3  # an exponential off by a bit rounds to the next float16
    np.testing.assert_allclose(found, case.outputs, atol=limit * np.abs(case.outputs).max())


@pytest.mark.parametrize("language", ["wgsl", "glsl"])
def test_float16_overflows_as_in_python(language, tmp_path):
    """A hidden value beyond 65504 is infinite, a small one rounds to a subnormal number."""
    if lacking := webgpu.missing(language):
        pytest.skip(f"no {lacking}: .ci/tools says how to get it")
    net = MLP(1, 1, 4, 1, activation=activations.linear, device="cpu")
    net.weights = [np.full((4, 1), 1e4), np.full((1, 4), 1.0)]
    net.biases = [np.zeros(4), np.zeros(1)]
    inputs = np.array([[1e2], [6.54], [6.56], [-9.0], [3e-10], [0.0]], np.float32)
    expected = net.evaluate(inputs).numpy()
    assert np.isinf(expected).any() and not np.isinf(expected).all()
    program, source = make_program(net.state), tmp_path / f"network.{SHADERS[language].suffix}"
    source.write_text(SHADERS[language]().source(program, "a test"))
    found, _seconds = webgpu.evaluate(webgpu.compiled(language, source, tmp_path), program.weights, inputs, 1)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("language", ["wgsl", "glsl", "hlsl", "slang"])
def test_textures_are_filtered_by_hardware(language, tmp_path):
    """A neural texture for engines: the exported folder's own rows, latents from its DDS files."""
    if lacking := webgpu.missing(language):
        pytest.skip(f"no {lacking}: .ci/tools says how to get it")
    if webgpu.BLOCKS not in webgpu.device().features:
        pytest.skip("no BC textures on this device")
    EngineTexture(make_state(), "cpu").save(tmp_path / "stone.safetensors")
    export(tmp_path / "stone.safetensors", language, tmp_path / "out")
    folder = tmp_path / "out"
    latents = [load_blocks(folder / f"stone_latent_{g}.dds") for g in range(3)]
    inputs, weights = (np.fromfile(folder / f"{name}.bin", np.float32) for name in ("inputs", "weights"))
    expected = np.fromfile(folder / "outputs.bin", np.float32).reshape(-1, 4)
    code = webgpu.compiled(language, folder / f"stone.{SHADERS[language].suffix}", tmp_path)
    found, _seconds = webgpu.evaluate(code, weights, inputs.reshape(-1, 3), 4, latents)
    difference = np.abs(found - expected) / [1, 1, 1, 7]  # of the channels' ranges
    assert difference.max() < 2 / 255 and np.std(expected[:, 0]) > 0.02


@pytest.mark.parametrize("target", ["cpp", "msl"])
def test_targets_without_textures(target, tmp_path):
    EngineTexture(make_state(), "cpu").save(tmp_path / "stone.safetensors")
    with pytest.raises(InputError, match=f"stone.safetensors: a texture is not exported to {target}; give one of hlsl"):
        export(tmp_path / "stone.safetensors", target, tmp_path / "out")
