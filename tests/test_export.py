"""Exported networks against Python: C++ and MSL by g++, folders as their README says, and what is refused."""

import shutil
import subprocess
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np
import pytest
from command_line import refused, run
from export_networks import CASES, ROWS, cases

import warp_neural as wn
from warp_neural.cli.export_command import Export
from warp_neural.errors import InputError
from warp_neural.export import TARGETS, export, spirv
from warp_neural.export.cpp import header
from warp_neural.export.folder import identifier
from warp_neural.export.images import image_shader
from warp_neural.export.program import make_program
from warp_neural.export.shaders import SHADERS
from warp_neural.export.statements import without_ternaries
from warp_neural.kernels.nn.activations import Activation

NATIVE = Path(__file__).parent / "native"
COMPILER = pytest.mark.skipif(not shutil.which("g++"), reason="no g++")
FLAGS = {"plain": ["-O3"], "native": ["-O3", "-march=native", "-ffp-contract=off"]}
RUN = """#include <cstdio>
template <int N, class F> void run(F f) {
    float x[N], y[3];
    for (int i = 0; i < %d; ++i) {
        if (std::fread(x, 4, N, stdin) != N) return;
        f(x, y);
        std::fwrite(y, 4, 3, stdout);
    }
}
int main() { %s }
"""
MSL = "-O1", "-Wno-attributes", "-Wno-comment", "-Wno-unused-parameter"
BAKED = [("gelu", "float32", True), ("HashGrid", "float32", True)]


def test_ternaries():
    assert without_ternaries("(z > 0.0f ? z : 0.5f * z)") == "(pick(z > 0.0f, z, 0.5f * z))"
    assert without_ternaries("a ? b : c ? d : e") == "pick(a, b, pick(c, d, e))"
    assert (
        without_ternaries("f(a ? b : c) + (d ? (e ? 1 : 2) : 3)") == "f(pick(a, b, c)) + (pick(d, (pick(e, 1, 2)), 3))"
    )


def compiled(source: str, folder: Path, *flags: str) -> Path:
    path = folder / "program.cpp"
    path.write_text(source)
    command = ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", *flags, str(path), "-o", str(path.with_suffix(""))]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:2000]
    return path.with_suffix("")


def results(program: Path, networks: list) -> list[np.ndarray]:
    given = b"".join(case.inputs.tobytes() for case in networks)
    done = subprocess.run([str(program)], input=given, stdout=subprocess.PIPE, check=True)
    return list(np.frombuffer(done.stdout, np.float32).reshape(len(networks), ROWS, 3))


@COMPILER
@pytest.mark.parametrize(("name", "precision"), CASES)
def test_cpp_is_equal_bit_for_bit(name, precision, tmp_path):
    """Over three networks each, 105 in all, without and with fused multiply-add of the processor."""
    networks = cases(name, precision)
    headers = [header(make_program(case.state, by_inputs=True), f"net{i}", "a test") for i, case in enumerate(networks)]
    calls = [f"run<net{i}::inputs>([](auto& x, auto& y) {{ net{i}::evaluate(x, y); }});" for i in range(len(networks))]
    source = "".join(headers).replace("#pragma once", "") + RUN % (ROWS, " ".join(calls))
    for flags in FLAGS.values():
        for case, found in zip(networks, results(compiled(source, tmp_path, *flags), networks), strict=True):
            np.testing.assert_array_equal(found.view(np.int32), case.outputs.view(np.int32))
            assert np.unique(found).size > ROWS  # not all the same


@COMPILER
@pytest.mark.parametrize(("name", "precision", "baked"), [(*case, False) for case in CASES[::3]] + BAKED)
def test_msl_as_cpp(name, precision, baked, tmp_path):
    """There is no compiler of MSL here: `native/metal.h` makes it C++."""
    (case, *_) = cases(name, precision)
    program = make_program(case.state, unrolled=baked)
    text = SHADERS["msl"]().source(program, "a test").replace("#include <metal_stdlib>", f'#include "{NATIVE}/metal.h"')
    weights = ", ".join(float(value).hex() + "f" for value in program.weights)
    call = f"run<{program.n_in}>([&](auto& x, auto& y) {{ evaluate(weights, x, y); }});"
    source = text + RUN % (ROWS, f"const float weights[] = {{{weights or 0}}}; {call}")
    (found,) = results(compiled(source, tmp_path, *MSL), [case])
    scale = np.abs(case.outputs).max()
    np.testing.assert_allclose(found, case.outputs, atol=(1e-5 if precision == "float32" else 1e-3) * scale)


@COMPILER
def test_msl_fills_an_image(tmp_path):
    net = wn.MLP(2, 3, 8, 1, precision="float32", seed=4, device="cpu")
    program = make_program(net.state, unrolled=True)
    text = image_shader("msl").source(program, "a test")
    text = text.replace("#include <metal_stdlib>", f'#include "{NATIVE}/metal.h"\n#include <cstdio>')
    source = (
        text
        + """int main() {
    float4 pixels[] = {{0, 0, 0, 0}, {0, 0, 0, 0}};
    for (uint i = 0; i < 3; ++i) fill(nullptr, texture2d<float, access::write>{pixels, 2, 1}, uint2{i, 0});
    std::fwrite(pixels, sizeof(pixels), 1, stdout);
}"""
    )
    program = compiled(source, tmp_path, *MSL)
    found = np.frombuffer(subprocess.run([str(program)], stdout=subprocess.PIPE, check=True).stdout, np.float32)
    expected = net.evaluate(np.array([[0.25, 0.5], [0.75, 0.5]], np.float32)).numpy()
    np.testing.assert_allclose(found.reshape(2, 4), np.hstack([expected, [[1], [1]]]), atol=1e-5)


@COMPILER
def test_the_folder_builds_as_its_readme_says(tmp_path):
    net = wn.MLP(2, 3, 16, 2, encoding=wn.encodings.Frequency(4), device="cpu")
    wn.save_network(tmp_path / "my-net.safetensors", net)
    found = export(tmp_path / "my-net.safetensors", "cpp", tmp_path / "out")
    assert set(map(Path, found["files"])) == set((tmp_path / "out").iterdir())
    folder = shutil.move(tmp_path / "out", tmp_path / "elsewhere")
    readme = (folder / "README.md").read_text()
    (command,) = (line.split("`")[3] for line in readme.splitlines() if "g++" in line)
    done = subprocess.run(command, shell=True, cwd=folder, capture_output=True, text=True)
    assert done.stdout == "256 rows, 0 results differ from Python's, by 0 at most\n", done.stderr
    assert found["hash"] in readme and wn.__version__ in readme
    (folder / "inputs.bin").unlink()
    done = subprocess.run("./a.out", cwd=folder, capture_output=True, text=True)
    assert done.returncode == 2 and "inputs.bin: cannot be read" in done.stderr


@pytest.mark.parametrize("target", TARGETS)
def test_exports_are_reproducible_and_never_overwrite(target, tmp_path):
    if target == "vulkan" and (lacking := spirv.missing("float16")):
        pytest.skip(f"no {lacking}: .ci/tools says how to get it")
    net, options = wn.MLP(2, 3, 8, 1, device="cpu", seed=3), {"name": "small net"}
    if target == "cuda":
        options["archs"] = [80]
    first = export(net, target, tmp_path / "a", **options)
    again = export(net.state, target, tmp_path / "b", **options)
    for one, other in zip(first["files"], again["files"], strict=True):
        assert Path(one).read_bytes() == Path(other).read_bytes()
    assert any(first["hash"] in Path(file).read_text(errors="replace") for file in first["files"])
    with pytest.raises(InputError, match="is there already; give --force"):
        export(net, target, tmp_path / "a", **options)
    net.biases = [b + 1 for b in net.biases]
    changed = export(net, target, tmp_path / "a", force=True, **options)
    assert changed["hash"] != first["hash"]


def test_what_cannot_be_exported_is_refused(tmp_path):
    def refuses(message, net, target="cpp", **options):
        with pytest.raises(InputError, match=message):
            export(net, target, tmp_path / "out", **options)
        assert not (tmp_path / "out").exists()

    net = wn.MLP(2, 2, 8, 1, device="cpu")
    refuses("give one of cpp, cuda, vulkan, glsl", net, "fortran")
    refuses("precision e4m3: is not exported yet; give one of float32, float16", net, precision="e4m3")
    refuses("precision double: is unknown", net, precision="double")
    refuses("4 networks in one; save them one by one", wn.MLP(2, 2, 8, 1, count=4, device="cpu"))
    for options in ({"precision": "e5m2"}, {"accumulation": "float16"}):
        refuses("give precision float16, the nearest", wn.MLP(2, 2, 8, 1, device="cpu", **options))
    own = Activation("own", "wp::atan(z)", "1.0f / (1.0f + z * z)")
    refuses("activation 'own' calls atan, which is not exported", wn.MLP(2, 2, 8, 1, activation=own, device="cpu"))
    (tmp_path / "a.safetensors").write_bytes(b"no network")
    refuses(r"a\.safetensors: not a whole safetensors file", tmp_path / "a.safetensors")


def test_numbers_that_are_not_finite_are_refused(tmp_path):
    net = wn.MLP(2, 2, 8, 1, device="cpu")
    for value in (np.nan, np.inf):
        net.biases = [b + value for b in net.biases]
        with pytest.raises(InputError, match="network: the parameters hold NaN or infinite values"):
            export(net, "cpp", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_folders_are_written_whole_or_not_at_all(tmp_path):
    (tmp_path / "out" / "README.md").mkdir(parents=True)
    with pytest.raises(InputError, match=r"README\.md: a folder or device"):
        export(wn.MLP(2, 2, 8, 1, device="cpu"), "glsl", tmp_path / "out", force=True)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["README.md"]


def test_names_that_languages_take():
    assert [identifier(name) for name in ("a-b c", "2x", "float", "net")] == [
        "a_b_c",
        "network_2x",
        "network_float",
        "net",
    ]


def test_another_precision_than_the_networks():
    """float32 leaves weights as they are, float16 rounds them."""
    state = cases("relu", "float16")[0].state
    weights = np.concatenate([w.ravel() for w in state.weights])
    exact, rounded = (make_program(state, precision).weights for precision in ("float32", "float16"))
    assert set(weights.tolist()) <= set(exact.tolist())
    assert set(weights.astype(np.float16).tolist()) <= set(rounded.tolist())


def test_the_command(tmp_path, capfd):
    assert get_args(get_type_hints(Export)["target"]) == TARGETS
    net = wn.MLP(2, 3, 8, 1, device="cpu")
    wn.save_network(tmp_path / "net.safetensors", net)
    said = run(capfd, "export", str(tmp_path / "net.safetensors"), "--target", "wgsl", "-o", str(tmp_path / "out"))
    assert said["target"] == "wgsl" and (tmp_path / "out" / "net.wgsl").is_file()
    again = refused(capfd, "export", str(tmp_path / "net.safetensors"), "--target", "wgsl", "-o", str(tmp_path / "out"))
    assert "is there already; give --force" in again
