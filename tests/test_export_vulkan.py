"""Exported folders for Vulkan: built with g++, run on the driver that is here, and what the program refuses."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from engine_textures import make_state
from export_networks import cases
from PIL import Image

import warp_neural as wn
from warp_neural.errors import InputError
from warp_neural.export import export, spirv
from warp_neural.export.program import make_program
from warp_neural.samples.deployment import vulkan
from warp_neural.texture.engine import EngineTexture

WARNINGS = "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O0"
NOWHERE = {"VK_ICD_FILENAMES": "/nowhere.json", "VK_DRIVER_FILES": "/nowhere.json"}
DONE = re.compile(r"device \d+, (.*): (\d+) rows, off by (\S+) of the largest result at most, allowed is (\S+)")


def run(program: Path, *arguments: str, **options) -> subprocess.CompletedProcess:
    command = [program, program.parent, "--rows", "1", *arguments]
    return subprocess.run(command, cwd=program.parent, capture_output=True, text=True, **options)


def finished(program: Path, *arguments: str) -> str:
    """What it prints; skips where there is no driver."""
    done = run(program, *arguments)
    if done.returncode == vulkan.NO_DRIVER:
        pytest.skip("no Vulkan driver: .ci/tools says how to get one")
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def program_of(source, folder: Path, **options) -> Path:
    if lacking := spirv.missing("float16") or vulkan.missing():
        pytest.skip(f"no {lacking}: .ci/tools says how to get it")
    export(source, "vulkan", folder, **{"name": "net"} | options)
    return vulkan.built(folder, folder / "program", *WARNINGS)


@pytest.fixture(scope="module")
def picture(tmp_path_factory) -> Path:
    """A program of a float16 network from (u, v) to colours."""
    net = wn.MLP(2, 3, 16, 2, encoding=wn.encodings.Frequency(3), precision="float16", device="cpu", seed=1)
    return program_of(net, tmp_path_factory.mktemp("picture"))


@pytest.mark.parametrize(
    ("name", "precision"),
    [("relu", "float32"), ("gelu", "float16"), ("HashGrid", "float32"), ("Concatenate", "float32")],
)
def test_results_are_those_of_python(name, precision, tmp_path):
    program = program_of(cases(name, precision)[0].state, tmp_path)
    said = finished(program, "--results", "results.bin", "--plain")
    how, rows, _difference, allowed = DONE.search(said).groups()
    assert (how, rows, float(allowed)) == ("plain", "256", 1e-5 if precision == "float32" else 1e-3)
    found, expected = (np.fromfile(tmp_path / f"{file}.bin", np.float32) for file in ("results", "outputs"))
    np.testing.assert_allclose(found, expected, atol=float(allowed) * np.abs(expected).max())
    assert np.unique(found).size > 256


def test_what_it_says_of_cooperative_vectors_is_so(picture):
    """By what it then runs, and by `vulkaninfo` where that is."""
    said = finished(picture)
    has = "VK_NV_cooperative_vector with float16 matrices" in said
    assert has != ("no VK_NV_cooperative_vector" in said)
    assert DONE.search(said)[1] == ("cooperative vectors" if has else "plain")
    assert DONE.search(finished(picture, "--plain"))[1] == "plain"
    if shutil.which("vulkaninfo"):
        listed = subprocess.run(["vulkaninfo"], capture_output=True, text=True).stdout
        assert ("VK_NV_cooperative_vector" in listed) == has


def test_more_rows_and_their_time(picture):
    said = finished(picture, "--rows", "1000")
    assert DONE.search(said)[2] == "1000"
    milliseconds, speed = re.search(r"([\d.]+) ms, the median of \d+ runs: (\S+) million rows", said).groups()
    assert float(speed) == pytest.approx(1e-3 * 1000 / float(milliseconds), rel=0.1)


def test_results_that_are_off(picture, tmp_path):
    shutil.copytree(picture.parent, tmp_path, dirs_exist_ok=True)
    finished(picture)
    expected = np.fromfile(tmp_path / "outputs.bin", np.float32)
    for value in (expected[7] + 0.1 * np.abs(expected).max(), np.nan):
        wrong = expected.copy()
        wrong[7] = value
        wrong.tofile(tmp_path / "outputs.bin")
        assert run(tmp_path / "program").returncode == 1


def test_the_picture(picture, tmp_path):
    finished(picture, "--image", str(tmp_path / "a.ppm"), "--plain")
    codes = np.asarray(Image.open(tmp_path / "a.ppm"))
    at = (np.arange(256) + 0.5) / 256
    v, u = np.meshgrid(at, at, indexing="ij")
    net = wn.MLP(2, 3, 16, 2, encoding=wn.encodings.Frequency(3), precision="float16", device="cpu", seed=1)
    linear = np.clip(net.evaluate(np.stack([u, v], -1).reshape(-1, 2).astype(np.float32)).numpy(), 0, 1)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.astype(float) ** (1 / 2.4) - 0.055)
    assert np.abs(codes.reshape(-1, 3) - 255 * srgb).max() < 2 and codes.std() > 5
    finished(picture)
    assert (picture.parent / "net.ppm").is_file()


def test_without_a_driver_or_a_loader(picture):
    done = run(picture, env=os.environ | NOWHERE)
    assert done.returncode == 77 and "install a GPU's driver" in done.stderr and done.stderr.count("\n") == 1


def test_files_that_are_not_the_networks(picture, tmp_path):
    finished(picture)
    for file in ("weights.bin", "net.spv", "inputs.bin"):
        data = (picture.parent / file).read_bytes()
        other = bytearray(data)
        other[8] ^= 1
        wrongs = {"truncated": data[:-2], "empty": b"", "missing": None}
        wrongs |= {"another": bytes(other), "longer": data + b"0123"} if file == "weights.bin" else {}
        for kind, wrong in wrongs.items():
            folder = shutil.copytree(picture.parent, tmp_path / f"{kind} {file}")
            (folder / file).unlink() if wrong is None else (folder / file).write_bytes(wrong)
            done = run(folder / "program", "--plain")
            assert done.returncode == 2 and done.stderr.count("\n") == 1, (kind, file, done.stderr)
            assert ("cannot be read" if wrong is None else "export it again") in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--device", "99"], r"--device 99: there are \d+, from 0 on"),
        (["--device", "-1"], "--device -1: give a whole number from 0 on"),
        (["--rows", "many"], "--rows many: give a whole number from 1 on"),
        (["--rows"], "--rows: its value is missing"),
        (["--fast"], "--fast: unknown"),
        (["--rows", "1000000000"], r"--rows 1000000000: this device takes \d+ at most"),
        (["--results", "/nowhere/results.bin"], r"/nowhere/results\.bin: cannot be written"),
    ],
)
def test_options_that_are_refused(picture, arguments, message):
    finished(picture)
    done = run(picture, *arguments)
    assert done.returncode == 2 and re.match(message, done.stderr)


def test_a_network_that_makes_no_picture(tmp_path):
    program = program_of(wn.MLP(3, 2, 8, 1, precision="float32", device="cpu"), tmp_path, name="cooperative")
    done = run(program, "--image", "a.ppm")
    assert done.returncode == 2 and "--image: for networks of 2 inputs and 3 results alone" in done.stderr
    finished(program)
    assert not list(tmp_path.glob("*.ppm")) and not list(tmp_path.glob("cooperative_*"))


@pytest.mark.skipif(not shutil.which("cmake"), reason="no cmake")
def test_the_folder_builds_as_its_readme_says(picture, tmp_path):
    finished(picture)
    folder = shutil.copytree(picture.parent, tmp_path / "elsewhere")
    readme = (folder / "README.md").read_text()
    (command,) = (line.strip() for line in readme.splitlines() if "cmake -B" in line)
    done = subprocess.run(command, shell=True, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0 and "100% tests passed" in done.stdout, done.stdout + done.stderr
    assert "net_cooperative.spv" in readme and "specialization constants" in readme


def test_without_compilers(tmp_path, monkeypatch):
    """What is missing, and each of the two where the other is not."""
    net = wn.MLP(2, 2, 8, 1, precision="float16", device="cpu")
    program = make_program(net.state)
    if spirv.slangc():
        with monkeypatch.context() as without:
            without.setattr(spirv.shutil, "which", lambda name: None)
            assert spirv.plain(program, "a test")[:4] == spirv.cooperative(program, "a test")[:4] == b"\x03\x02\x23\x07"
    monkeypatch.setattr(spirv, "slangc", lambda: None)
    which = shutil.which
    monkeypatch.setattr(spirv.shutil, "which", lambda name: None)
    with pytest.raises(
        InputError, match=r"network: target vulkan makes SPIR-V, install glslangValidator .*, or slangc"
    ):
        export(net, "vulkan", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert [spirv.missing(precision) for precision in ("float32", "float16")] == [
        "glslangValidator or slangc",
        "glslangValidator 15 or newer or slangc",
    ]
    monkeypatch.setattr(spirv.shutil, "which", which)
    if spirv.glslang():
        monkeypatch.setattr(spirv, "glslang", lambda: 12)
        with pytest.raises(InputError, match=r"float16 has cooperative vectors: install .*; 15 or newer.*float32"):
            export(net, "vulkan", tmp_path / "out")


def test_textures_are_refused(tmp_path):
    EngineTexture(make_state(), "cpu").save(tmp_path / "stone.safetensors")
    with pytest.raises(InputError, match="a texture is not exported to vulkan; give one of hlsl"):
        export(tmp_path / "stone.safetensors", "vulkan", tmp_path / "out")
