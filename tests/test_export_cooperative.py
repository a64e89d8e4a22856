"""Exported shaders with cooperative vectors: as C++ in place of a device, by their compilers, and what is refused."""

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import refused, run
from engine_textures import make_state
from export_networks import CASES, ROWS, cases

import warp_neural as wn
from warp_neural.errors import InputError
from warp_neural.export import TARGETS, export, spirv
from warp_neural.export.cooperative import BIAS, COOPERATIVE, MATRIX, matrices, places
from warp_neural.export.program import Program, make_program
from warp_neural.texture.engine import EngineTexture

NATIVE = Path(__file__).parent / "native"
RUNS = {
    "glsl": ["relu", "linear", "elu", "gelu", "HashGrid", "Concatenate"],
    "slang": ["relu", "squareplus", "Frequency"],
}
RUNS["hlsl"] = ["relu", "sigmoid", "LatentTexture"]
RUN = """#include <cstdio>
#include <cstdlib>
#include "cooperative.h"
float weights[%d];
char bytes[%d];
Bytes matrices = bytes;
%s
int main() {
    float x[%d], y[3];
    if (!std::fread(weights, sizeof(weights), 1, stdin) || !std::fread(bytes, sizeof(bytes), 1, stdin)) return 1;
    for (int i = 0; i < %d; ++i) {
        if (!std::fread(x, sizeof(x), 1, stdin)) return 1;
        evaluate(x, y);
        std::fwrite(y, sizeof(y), 1, stdout);
    }
}
"""


def as_cpp(language: str, program: Program) -> str:
    """Up to the entry, without declarations, which differ, and with matrices where they are in the file."""
    text = COOPERATIVE[language]().source(program, "a test")
    text = re.split(r"\n(?:void main|\[numthreads|\[shader)", text)[0]
    text = text.replace("[[unroll]]", "").replace("[unroll]", "")
    lines = [line for line in text.splitlines() if not re.search(r"^#|^\[\[|^layout|register\(|matrix\d.*;$|^};", line)]
    offsets = [f"const uint matrix{l} = {place.matrix};" for l, place in enumerate(places(program))]
    return "\n".join([*offsets, *lines])


@pytest.mark.skipif(not shutil.which("g++"), reason="no g++")
@pytest.mark.parametrize(("language", "name"), [(language, name) for language in RUNS for name in RUNS[language]])
def test_shaders_as_cpp_give_what_python_gives(language, name, tmp_path):
    """What a device would do but for its own layout and order of sums."""
    case = cases(name, "float16" if (name, "float16") in CASES else "float32")[0]
    program, path = make_program(case.state, "float16"), tmp_path / "program.cpp"
    sizes = len(program.weights), len(matrices(program))
    path.write_text(RUN % (*sizes, as_cpp(language, program), program.n_in, ROWS))
    command = ["g++", "-std=c++17", "-O1", "-Wall", "-Werror", "-Wno-unused", f"-I{NATIVE}", path, "-o", tmp_path / "a"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:2000]
    given = program.weights.astype("<f4").tobytes() + matrices(program) + case.inputs.tobytes()
    done = subprocess.run([tmp_path / "a"], input=given, stdout=subprocess.PIPE, check=True)
    found = np.frombuffer(done.stdout, np.float32).reshape(ROWS, 3)
    np.testing.assert_allclose(found, case.outputs, atol=1e-2 * np.abs(case.outputs).max())
    assert np.unique(found).size > ROWS


def test_matrices_hold_what_products_read():
    """Aligned, apart, float16; Python's results from the bytes alone."""
    case = cases("relu", "float16")[0]
    program = make_program(case.state)
    data, x, end = matrices(program), case.inputs.astype(np.float16).astype(np.float32), 0
    found = places(program)
    for at, size in [(p.bias, 2 * p.rows) for p in found] + [(p.matrix, 2 * p.rows * p.columns) for p in found]:
        assert at >= end
        end = at + size
    assert end <= len(data) and len(data) % MATRIX == 0
    for l, place in enumerate(found):
        assert place.bias % BIAS == 0 and place.matrix % MATRIX == 0
        w = np.frombuffer(data, "<f2", place.rows * place.columns, place.matrix).reshape(place.rows, place.columns)
        x = x @ w.astype(np.float32).T + np.frombuffer(data, "<f2", place.rows, place.bias)
        x = (np.maximum(x, 0) if l < len(found) - 1 else x).astype(np.float16).astype(np.float32)
    np.testing.assert_allclose(x, case.outputs, atol=2e-3 * np.abs(case.outputs).max())


@pytest.mark.parametrize("name", ["relu", "HashGrid", "Concatenate"])
@pytest.mark.parametrize("language", ["glsl", "slang"])
def test_compilers_take_them(language, name, tmp_path, monkeypatch):
    if language == "glsl" and spirv.glslang() < spirv.COOPERATIVE:
        pytest.skip("no glslangValidator 15 or newer: .ci/tools says how to get it")
    if language == "slang" and not spirv.slangc():
        pytest.skip("no slangc: pip install --no-deps slangtorch")
    if language == "slang":
        monkeypatch.setattr(spirv.shutil, "which", lambda name: None)
    program = make_program(cases(name, "float16" if name == "relu" else "float32")[0].state, "float16")
    words = np.frombuffer(spirv.cooperative(program, "a test"), "<u4")
    assert words[0] == 0x07230203
    assert any(word & 0xFFFF == 5292 for word in words)  # OpCooperativeVectorMatrixMulAddNV


@pytest.mark.parametrize("target", COOPERATIVE)
def test_the_folder_has_both_forms(target, tmp_path):
    net = wn.MLP(3, 2, 8, 1, precision="float16", device="cpu", seed=3)
    plain = export(net, target, tmp_path / "plain", name="small")["files"]
    both = export(net, target, tmp_path / "both", name="small", cooperative=True)["files"]
    names = {Path(file).name for file in both} - {Path(file).name for file in plain}
    assert names == {"matrices.bin", f"small_cooperative.{COOPERATIVE[target].suffix}"}
    for file in plain:
        same = Path(file).read_bytes() == (tmp_path / "both" / Path(file).name).read_bytes()
        assert same == (Path(file).name != "README.md")
    again = export(net.state, target, tmp_path / "again", name="small", cooperative=True)["files"]
    assert all(Path(a).read_bytes() == Path(b).read_bytes() for a, b in zip(both, again, strict=True))
    readme = (tmp_path / "both" / "README.md").read_text()
    assert all(
        f"| {l} | {p.rows} | {p.columns} | {p.matrix} |" in readme
        for l, p in enumerate(places(make_program(net.state)))
    )


def test_what_cannot_be_cooperative_is_refused(tmp_path):
    def refuses(message, target="glsl", source=None, **options):
        with pytest.raises(InputError, match=message):
            export(source or net, target, tmp_path / "out", cooperative=True, **options)
        assert not (tmp_path / "out").exists()

    net = wn.MLP(2, 2, 8, 1, device="cpu", precision="float16")
    for target in set(TARGETS) - set(COOPERATIVE):
        refuses(f"cooperative: not for {target}; give one of glsl, slang, hlsl", target)
    refuses("are of float16, not float32; give precision float16", precision="float32")
    beyond = "of size 100000 is beyond float16; give precision float32"
    large = replace(net.state, parameters=np.full_like(net.state.parameters, 1e5))
    refuses(f"a weight {beyond}", source=large)
    net.biases = [b + 1e5 for b in net.biases]
    refuses(f"network: a bias {beyond}")
    EngineTexture(make_state(), "cpu").save(tmp_path / "stone.safetensors")
    refuses("cooperative: not for textures", source=tmp_path / "stone.safetensors")


def test_the_command(tmp_path, capfd):
    wn.save_network(tmp_path / "net.safetensors", wn.MLP(2, 3, 8, 1, precision="float16", device="cpu"))
    arguments = ["export", str(tmp_path / "net.safetensors"), "--cooperative", "-o", str(tmp_path / "out"), "--target"]
    said = run(capfd, *arguments, "slang")
    assert (tmp_path / "out" / "net_cooperative.slang").is_file() and said["precision"] == "float16"
    assert "cooperative: not for wgsl; give one of glsl" in refused(capfd, *arguments, "wgsl")
