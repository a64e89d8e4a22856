"""Folders for CUDA: built by any C++ compiler; on a GPU the same bits as Python's there."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from command_line import refused

import warp_neural as wn
from warp_neural.errors import InputError
from warp_neural.export import export
from warp_neural.kernels.nn.spec import FORMATS

COMPILER = pytest.mark.skipif(not shutil.which("g++"), reason="no g++")
FLAGS = "-std=c++17", "-O1", "-Wall", "-Wextra", "-Werror"
VALUES = 0.0, -2.5, 65504.0, 65519.0, 65520.0, 5.9604645e-08, 1e-9, 0.1, 6.1e-05, -1e9  # as float16
CASES = {
    "warpgroups": (48, 5, {"width": 64, "depth": 2, "dtype": wp.float16, "accumulation": "float16"}),
    "wide warpgroups": (16, 16, {"width": 128, "depth": 2, "dtype": wp.float16}),
    "several": (7, 3, {"width": 32, "depth": 1, "count": 3}),
    "frequency": (2, 3, {"width": 32, "depth": 2, "encoding": wn.encodings.Frequency(3), "precision": "float32"}),
    "hash grid": (2, 3, {"width": 16, "depth": 1, "encoding": wn.encodings.HashGrid(levels=4, log2_size=10)}),
    **{name: (20, 4, {"width": 24, "depth": 2, "precision": name}) for name in FORMATS},
}


def make_net(case: str, device) -> wn.MLP:
    n_in, n_out, kind = CASES[case]
    return wn.MLP(n_in, n_out, kind["width"], kind["depth"], seed=3, device=device, **dict(list(kind.items())[2:]))


def built(folder: Path, source: str = "main.cpp") -> Path:
    command = ["g++", *FLAGS, str(folder / source), "-o", str(folder / "program"), "-ldl"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:2000]
    return folder / "program"


def run(program: Path, *arguments: object) -> subprocess.CompletedProcess:
    return subprocess.run([str(program), *map(str, arguments)], capture_output=True, text=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("cuda") / "net"
    made = export(make_net("warpgroups", "cpu"), "cuda", path, name="net", archs=[90, 80])
    assert made["precision"] == "float16" and f'hash[] = "{made["hash"]}"' in (path / "net.hpp").read_text()
    return path


def test_files(folder):
    """The kernels of both architectures and PTX of the older; nothing of where they were made."""
    names = {path.name for path in folder.iterdir() if path.suffix in (".cubin", ".ptx")}
    assert names == {
        f"{kind}.{end}" for kind in ("pack", "rows") for end in ("sm80.cubin", "sm90.cubin", "sm80.ptx")
    } | {"groups.sm90a.cubin"}
    assert all(str(folder.parent).encode() not in path.read_bytes() for path in folder.iterdir())
    assert "compute capability 8.0, 9.0," in (folder / "README.md").read_text()


@COMPILER
def test_which_kernel_a_device_takes(folder):
    asked = "75 80 86 90 100 120".split()
    (folder / "choose.cpp").write_text(f"""#include <cstdio>
#include "net.hpp"
int main() {{
    using namespace net::detail;
    for (int arch : {{{", ".join(asked)}}})
        for (Kind kind : {{Kind::rows, Kind::groups}}) {{
            const Binary* const found = choose(kind, arch);
            std::printf("%s ", found ? found->file : "none");
        }}
    for (double value : {{{", ".join(map(str, VALUES))}}}) {{
        std::uint16_t half;
        net::element_of(static_cast<float>(value), half);
        std::printf("%x:%.9g ", half, net::value_of(half));
    }}
}}
""")
    words = run(built(folder, "choose.cpp")).stdout.split()
    ptx, own = ["rows.sm80.ptx", "none"], ["rows.sm80.cubin", "none"]
    assert words[:12] == ["none", "none", *own, *own, "rows.sm90.cubin", "groups.sm90a.cubin", *ptx, *ptx]
    with np.errstate(over="ignore"):
        halves = np.float32(VALUES).astype(np.float16)
    assert words[12:] == [f"{half.view(np.uint16):x}:{np.float32(half):.9g}" for half in halves]


@COMPILER
def test_program_without_a_device(folder, tmp_path):
    """One line each: broken files, then, where there is no driver, that."""
    copy = Path(shutil.copytree(folder, tmp_path / "net"))
    program = built(copy)
    weights = (copy / "weights.bin").read_bytes()
    (copy / "weights.bin").write_bytes(weights[:-4])
    done = run(program, copy)
    assert done.returncode == 2
    assert (
        done.stderr == f"{copy}/weights.bin: {len(weights) - 4} bytes, not {len(weights)}; export the network again\n"
    )
    (copy / "inputs.bin").unlink()
    assert run(program, copy).stderr == f"{copy}/inputs.bin: cannot be read; give the exported folder\n"
    assert run(program, "--device", "x").stderr == "--device x: give its number, from 0 on\n"
    assert run(program, "--quick").returncode == 2
    if not wp.is_cuda_available():
        done = run(program, folder)
        assert done.returncode == 77 and done.stderr.startswith("no CUDA driver: libcuda.so.1"), done


@COMPILER
@pytest.mark.parametrize("case", CASES)
def test_same_bits_on_a_gpu(device, case, tmp_path):
    if device.is_cpu:
        pytest.skip("needs a GPU")
    net = make_net(case, device)
    export(net, "cuda", tmp_path, name="net", archs=[device.arch])
    done = run(built(tmp_path), tmp_path, "--results", tmp_path / "results.bin")
    assert done.returncode == 0 and "TFLOP/s" in done.stdout, done
    inputs = np.fromfile(tmp_path / "inputs.bin", np.float32).reshape(-1, net.n_in)
    expected = net.evaluate(inputs.astype(np.float16) if net.spec.dtype is wp.float16 else inputs).numpy()
    found = np.fromfile(tmp_path / "results.bin", np.float32).reshape(expected.shape)
    assert np.array_equal(found, expected.astype(np.float32))
    assert ("by warpgroups" in done.stdout) == ("warpgroups" in case and device.arch == 90)
    assert (tmp_path / "picture.ppm").is_file() == (case in ("frequency", "hash grid"))


def test_refusals(tmp_path, capfd):
    net = make_net("frequency", "cpu")
    with pytest.raises(InputError, match="--arch 42: give some of 75, 80"):
        export(net, "cuda", tmp_path, archs=[42])
    with pytest.raises(InputError, match="target cuda alone has them"):
        export(net, "cpp", tmp_path, archs=[80])
    wn.save_network(tmp_path / "net.safetensors", net)
    command = "export", str(tmp_path / "net.safetensors"), "--target", "cuda", "-o", str(tmp_path)
    assert "--arch new: give numbers such as 80,90,120" in refused(capfd, *command, "--arch", "new")
    assert [path.name for path in tmp_path.iterdir()] == ["net.safetensors"]
