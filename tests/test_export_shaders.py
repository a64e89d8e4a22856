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


@pytest.mark.parametrize("language", EVERY)
def test_own_half(language, tmp_path):
    """Of the device; glslang makes no float16 of HLSL."""
    if lacking := webgpu.missing(language):
        pytest.skip(f"no {lacking}: .ci/tools says how to get it")
    if webgpu.HALF not in webgpu.device().features or language == "hlsl":
        pytest.skip("no float16 here")
    (case, *_) = cases("elu", "float16")
    export(case.state, language, tmp_path, name="network", half=True)
    source = tmp_path / f"network.{SHADERS[language].suffix}"
    assert (
        "f16(" in source.read_text() or "float16_t(" in source.read_text()
    ) and "0x477ff000" not in source.read_text()
    weights = np.fromfile(tmp_path / "weights.bin", np.float32)
    found, _seconds = webgpu.evaluate(webgpu.compiled(language, source, tmp_path), weights, case.inputs, 3)
    np.testing.assert_allclose(found, case.outputs, atol=1e-3 * np.abs(case.outputs).max())


@pytest.mark.parametrize("language", EVERY)
@pytest.mark.parametrize("name", ["gelu", "HashGrid"])
def test_baked_weights(language, name, tmp_path):
    """Unrolled, with sizes that are no multiples of four; only the encoding's parameters are a buffer."""
    if lacking := webgpu.missing(language):
        pytest.skip(f"no {lacking}: .ci/tools says how to get it")
    (case, *_) = cases(name, "float32")
    made = export(case.state, language, tmp_path, name="network", baked=True)
    path = tmp_path / "weights.bin"
    weights = np.fromfile(path, np.float32) if name == "HashGrid" else np.empty(0, np.float32)
    assert path.exists() == (name == "HashGrid") and weights.size == case.state.encoding_parameters.size
    code = webgpu.compiled(language, tmp_path / f"network.{SHADERS[language].suffix}", tmp_path)
    found, _seconds = webgpu.evaluate(code, weights, case.inputs, case.outputs.shape[1])
    np.testing.assert_allclose(found, case.outputs, atol=1e-5 * np.abs(case.outputs).max())
    assert str(made["hash"]) in (tmp_path / "README.md").read_text()


@pytest.mark.parametrize("language", EVERY)
@pytest.mark.parametrize("baked", [False, True])
def test_images(language, baked, tmp_path):
    """Of a width that is no multiple of a group; the entry gets its own size."""
    if lacking := webgpu.missing(language):
        pytest.skip(f"no {lacking}: .ci/tools says how to get it")
    net = MLP(2, 3, 12, 1, precision="float32", activation=activations.tanh, seed=4, device="cpu")
    export(net, language, tmp_path, name="network", baked=baked)
    weights = np.empty(0, np.float32) if baked else np.fromfile(tmp_path / "weights.bin", np.float32)
    code = webgpu.compiled(language, tmp_path / f"network_image.{SHADERS[language].suffix}", tmp_path)
    if language == "hlsl":
        pytest.skip("compiled; WebGPU has no images to read and write, which HLSL's are")
    image = webgpu.fill(code, weights, 44, 21)
    v, u = np.meshgrid((np.arange(21) + 0.5) / 21, (np.arange(44) + 0.5) / 44, indexing="ij")
    expected = net.evaluate(np.stack([u, v], -1).reshape(-1, 2).astype(np.float32)).numpy().reshape(21, 44, 3)
    np.testing.assert_allclose(image[..., :3], expected, atol=1e-3 * np.abs(expected).max())
    assert (image[..., 3] == 1).all() and np.ptp(expected) > 0.1


def test_what_shaders_do_not_bake(tmp_path):
    wide = MLP(2, 3, 144, 1, device="cpu")
    with pytest.raises(
        InputError, match="a layer of 144: as constants they have up to 128; give target wgsl, not baked"
    ):
        export(wide, "glsl", tmp_path / "out", baked=True)
    for option in ("baked", "half"):
        with pytest.raises(InputError, match=f"{option}: not for cpp; give one of glsl, hlsl, slang, wgsl, msl"):
            export(MLP(2, 3, 8, 1, device="cpu"), "cpp", tmp_path / "out", **{option: True})
    assert not (tmp_path / "out").exists()


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
