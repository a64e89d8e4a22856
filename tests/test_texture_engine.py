"""Neural textures for engines: latents in BC1 blocks, read by kernels and by other decoders, and their files."""

import json
from dataclasses import replace

import numpy as np
import pytest
import texture2ddecoder
import warp as wp
from command_line import run
from engine_textures import MAPS, SPEC, make_state
from reference_blocks import bilinear, decoded
from texture_maps import random_points, samples, texels

import warp_neural as wn
from warp_neural.errors import InputError
from warp_neural.imaging.block_files import load_blocks
from warp_neural.imaging.image import load_stored, save_image
from warp_neural.io.tensors import load_tensors, save_tensors
from warp_neural.texture.engine import EngineTexture
from warp_neural.texture.presets import BLOCKS, block_spec


@pytest.fixture(scope="module")
def texture(device):
    return EngineTexture(make_state(), device)


def latents_of(state, mip):
    return [4 * (decoded(state.spec, state.blocks, g, mip) / 255 - 0.5) for g in range(len(state.spec.scales))]


def network(state, x):
    """As stored."""
    for l in range(3):
        x = x @ state.tensors[f"weights_{l}"].values.T.astype(np.float64) + state.tensors[f"biases_{l}"].values
        x = np.where(x > 0, x, np.expm1(np.minimum(x, 0))) if l < 2 else x
    low, high = np.array([0, 0, 0, -2.0]), np.array([1, 1, 1, 5.0])
    return low + np.clip(x, 0, 1) * (high - low)


def truth(state, points):
    """Of u, v and level [points, 3]."""
    level = np.clip(points[:, 2], 0, state.spec.mips - 1)
    mip, x = np.minimum(level.astype(int), state.spec.mips - 1), []
    both = [np.concatenate([bilinear(each, points[:, :2]) for each in latents_of(state, m)], -1) for m in range(4)]
    for n, (m, f) in enumerate(zip(mip, level - mip, strict=True)):
        x.append(np.append((1 - f) * both[m][n] + f * both[min(m + 1, 3)][n], level[n] / 8))
    return network(state, np.array(x))


def test_samples_and_texels(texture, device):
    """Against texture2ddecoder, a bilinear filter and the network in float64."""
    points = random_points(np.random.default_rng(0), 300, SPEC.mips)
    np.testing.assert_allclose(samples(texture, points, 4, device), truth(texture.state, np.float64(points)), atol=5e-3)
    rng = np.random.default_rng(1)
    mips = rng.integers(0, SPEC.mips, 200)
    sizes = np.array([SPEC.size(mip) for mip in mips])
    places = np.column_stack([rng.integers(-50, 50, (200, 2)), mips])
    uv = (places[:, 1::-1] + 0.5) / sizes[:, ::-1]
    expected = truth(texture.state, np.column_stack([uv, mips]))
    np.testing.assert_allclose(texels(texture, places, 4, device), expected, atol=5e-3)


def test_gradients_of_samples(texture, device):
    """To uv and level, against central differences in float64."""
    sample, params_type, vec = texture.sample, texture.Params, wp.types.vector(4, float)

    @wp.kernel(module="unique")
    def kernel(params: params_type, uv: wp.array[wp.vec2], lod: wp.array[float], y: wp.array[vec]):
        i = wp.tid()
        y[i] = sample(params, uv[i], lod[i])

    rng, count = np.random.default_rng(2), 64
    points = np.column_stack([rng.uniform(-1, 2, (count, 2)), rng.uniform(-0.5, 3.5, count)]).astype(np.float32)
    uv = wp.array(points[:, :2], dtype=wp.vec2, device=device, requires_grad=True)
    lod = wp.array(points[:, 2], device=device, requires_grad=True)
    y = wp.zeros(count, dtype=vec, device=device, requires_grad=True)
    adjoint = rng.normal(size=(count, 4)).astype(np.float32)
    with wp.Tape() as tape:
        wp.launch(kernel, count, [texture.params, uv, lod], [y], device=device)
    tape.backward(grads={y: wp.array(adjoint, dtype=vec, device=device)})
    for k, found in enumerate([*uv.grad.numpy().T, lod.grad.numpy()]):
        step = 1e-6 * np.eye(3)[k]
        ends = (truth(texture.state, np.float64(points) + sign * step) for sign in (1, -1))
        expected = ((next(ends) - next(ends)) / 2e-6 * adjoint).sum(-1)
        np.testing.assert_allclose(found, expected, atol=1e-2 * np.abs(expected).max())


def test_whole_pictures_are_texels(texture, device):
    height, width = SPEC.size(1)
    places = np.array([(i, j, 1) for i in range(height) for j in range(width)])
    maps = texture.decode(1)
    both = np.concatenate([maps["albedo"], maps["height"][..., :1]], -1).reshape(-1, 4)
    np.testing.assert_allclose(both, texels(texture, places, 4, device), atol=1e-5)
    assert (maps["height"][..., 1] == 0.5).all()
    part = texture.decode(0, (3, 5, 7, 9))["albedo"]
    np.testing.assert_allclose(part, texture.decode()["albedo"][5:14, 3:10], atol=1e-5)  # lanes may be missing


@pytest.mark.parametrize("file", ["dds", "ktx2"])
def test_files(file, tmp_path):
    state = make_state()
    parts = EngineTexture(state, "cpu").save(tmp_path / "stone.safetensors", file)
    again = wn.texture.load(tmp_path / "stone.safetensors", "cpu")
    assert isinstance(again, EngineTexture) and again.state.spec == SPEC and again.state.maps == MAPS
    assert again.metrics == {"psnr": 31.5}
    for name, tensor in state.tensors.items():
        np.testing.assert_array_equal(again.state.tensors[name].integers, tensor.integers)
    for g in range(3):
        path = tmp_path / f"stone_latent_{g}.{file}"
        assert parts["latents"][g] == path.stat().st_size
        texture = load_blocks(path)
        rows, columns = SPEC.latents(0, g)
        data = texture2ddecoder.decode_bc1(texture.levels[0], columns, rows)
        codes = np.frombuffer(data, np.uint8).reshape(rows, columns, 4)[..., 2::-1]
        np.testing.assert_array_equal(codes, decoded(SPEC, state.blocks, g, 0))
        for mip in range(SPEC.mips):
            np.testing.assert_array_equal(again.state.blocks[g][mip], state.blocks[g][mip])
    net = wn.load_network(tmp_path / "stone.safetensors", device="cpu")
    assert net.n_in == SPEC.n_in and net.n_out == 4


def test_files_that_do_not_fit_are_refused(tmp_path):
    path, state = tmp_path / "a.safetensors", make_state()
    EngineTexture(state, "cpu").save(path)
    with pytest.raises(InputError, match=r"name it \.safetensors"):
        EngineTexture(state, "cpu").save(tmp_path / "a.wntc")
    whole = (tmp_path / "a_latent_1.dds").read_bytes()
    (tmp_path / "a_latent_1.dds").write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    with pytest.raises(InputError, match=r"a_latent_1\.dds: not the latent texture that a\.safetensors was"):
        wn.texture.load(path, "cpu")
    (tmp_path / "a_latent_1.dds").unlink()
    with pytest.raises(InputError, match=r"a_latent_1\.dds: cannot be read"):
        wn.texture.load(path, "cpu")
    net = wn.MLP(2, 3, 16, 1, device="cpu")
    wn.save_network(tmp_path / "net.safetensors", net)
    with pytest.raises(InputError, match=r"net\.safetensors: a network without a texture"):
        wn.texture.load(tmp_path / "net.safetensors", "cpu")


CHANGES = {
    "scales": [1, 2],
    "mips": 99,
    "height": "tall",
    "maps": [["albedo", "srgb", [0.0], [1.0], "", 8]],
    "latents": [{"file": 5}],
    "steps": {},
    "metrics": 3,
}


@pytest.mark.parametrize("name", [*CHANGES, "scale of none"])
def test_hostile_metadata_is_refused(name, tmp_path):
    path = tmp_path / "a.safetensors"
    EngineTexture(make_state(), "cpu").save(path)
    tensors, metadata = load_tensors(path)
    metadata = json.loads(json.dumps(metadata))
    if name in CHANGES:
        metadata["extra"]["texture"][name] = CHANGES[name]
    else:
        metadata["extra"]["texture"] |= {"scales": [], "latents": []}
    save_tensors(path, tensors, metadata)
    with pytest.raises(InputError, match=r"a\.safetensors: "):
        wn.texture.load(path, "cpu")


@pytest.mark.parametrize("bits", BLOCKS)
def test_presets_take_the_bits_of_their_names(bits):
    spec = block_spec(256, 256, 8, 1, bits)
    assert spec.resident_bits == bits and spec.scales == BLOCKS[bits]


def test_compressed_for_engines(device, tmp_path):
    i, j = np.mgrid[:32, :32]
    picture = 0.5 + 0.3 * np.stack([np.sin(i / 4), np.cos(j / 3), np.sin((i + j) / 5)], -1)
    texture = wn.texture.compress({"albedo": picture}, bpp=5, storage="engine", steps=600, device=device, quiet=True)
    assert isinstance(texture, EngineTexture)
    metrics = texture.metrics
    assert metrics["resident_bits"] == 5 and metrics["psnr"] > 25
    error = np.square(texture.decode()["albedo"] - picture).mean()
    assert metrics["psnr"] == pytest.approx(-10 * np.log10(error), abs=0.1)  # where it is clipped
    texture.save(tmp_path / "a.safetensors")
    again = wn.texture.load(tmp_path / "a.safetensors", device)
    np.testing.assert_array_equal(again.decode()["albedo"], texture.decode()["albedo"])


def test_the_commands(device, tmp_path, capfd):
    """compress, info and decompress."""
    picture = np.random.default_rng(0).random((16, 16, 3))
    save_image(tmp_path / "stone" / "albedo.png", picture, color_space="linear")
    out, where = tmp_path / "stone.safetensors", ["--device", str(device)]
    options = ["-o", str(out), "--for", "engine", "--bpp", "5", "--steps", "100", "--ktx2", *where]
    said = run(capfd, "compress", str(tmp_path / "stone"), *options)
    files = sorted(tmp_path.glob("stone_latent_*.ktx2"))
    assert len(files) == 5 and said["bytes"] == sum(path.stat().st_size for path in [out, *files])
    described = run(capfd, "info", str(out))
    assert described["format"] == "engine" and described["scales"] == [2] * 5
    assert {key: described[key] for key in ("bytes", "maps", "metrics")} == {
        key: said[key] for key in ("bytes", "maps", "metrics")
    }
    run(capfd, "decompress", str(out), "-o", str(tmp_path / "maps"), *where)
    written = load_stored(tmp_path / "maps" / "albedo.png")[0]
    expected = wn.texture.load(out, device).decode()["albedo"]
    np.testing.assert_allclose(np.asarray(written, np.float64).reshape(expected.shape), expected, atol=1 / 255)


def test_goals_that_are_not_for_engines():
    picture = {"albedo": np.random.default_rng(0).random((32, 32, 3))}
    with pytest.raises(InputError, match='size=9000: expected left out with storage "engine"'):
        wn.texture.compress(picture, size=9000, storage="engine", device="cpu")
    with pytest.raises(InputError, match=r"bpp 1: latents of this texture take at least 2\.5 bits a texel"):
        wn.texture.compress(picture, bpp=1, storage="engine", device="cpu")


def test_any_parts_are_checked():
    state = make_state()
    with pytest.raises(InputError, match="latent texture 0, mip 1: expected uint32"):
        replace(state, blocks=((state.blocks[0][0],) * 4, *state.blocks[1:]))
