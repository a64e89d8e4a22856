"""What is installed is `warp_neural` alone; a checkout has `kernels` and `samples` as other names of its parts."""

import json
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("warp_neural", "kernels", "samples")
NOT_COPIED = shutil.ignore_patterns(".*", "*.egg-info", "__pycache__", "build", "dist", "out")

# as the package of that name on PyPI begins
OTHER_KERNELS = """
from kernels.utils import get_kernel
__all__ = ["get_kernel"]
"""


def python(*arguments, path: Path | None, cwd: Path) -> str:
    """What a Python started in `cwd`, with `path` before all that is installed, prints."""
    paths = [str(path)] * (path is not None) + os.environ.get("PYTHONPATH", "").split(os.pathsep)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    run = subprocess.run([sys.executable, *arguments], cwd=cwd, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return run.stdout


def build(source: Path, kind: str, out: Path) -> Path:
    """As `pip` calls it, but with the setuptools that is here instead of one downloaded."""
    python("-c", f"from setuptools import build_meta; build_meta.build_{kind}({str(out)!r})", path=None, cwd=source)
    (built,) = out.iterdir()
    return built


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """The files of the checkout, as the source distribution brings them; made where no file of an earlier build is."""
    folder = tmp_path_factory.mktemp("source")
    shutil.copytree(ROOT, folder / "checkout", ignore=NOT_COPIED)
    with tarfile.open(build(folder / "checkout", "sdist", folder / "sdist")) as archive:
        archive.extractall(folder, filter="data")
    return folder / "warp_neural-0.1.0"


@pytest.fixture(scope="module")
def site(source, tmp_path_factory):
    """A folder with the wheel unpacked, beside another package named `kernels`."""
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(build(source, "wheel", tmp_path_factory.mktemp("wheel"))) as wheel:
        wheel.extractall(folder)
    return folder


def files(folder: Path) -> set[str]:
    found = {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}
    return {path.as_posix() for path in found if not {"__pycache__", "warp_neural.egg-info"} & set(path.parts)}


def test_the_source_distribution_holds_what_the_tests_need(source):
    for name in (*FOLDERS, "tests", "perf", "docs"):
        assert files(source / name) == files(ROOT / name), name
    for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "LICENSE", "pyproject.toml", "setup.py"):
        assert (source / name).read_bytes() == (ROOT / name).read_bytes()


def test_the_wheel_holds_one_package(site):
    installed = {name for name in files(site) if ".dist-info/" not in name}
    inside = {name: name if name == "warp_neural" else f"warp_neural/{name}" for name in FOLDERS}
    assert installed == {f"{inside[name]}/{path}" for name in FOLDERS for path in files(ROOT / name)}
    assert "warp_neural/py.typed" in installed


BESIDE = """
import runpy, sys
import kernels, warp_neural
from warp_neural import kernels as ours
from warp_neural.kernels.nn.mlp import make_mlp
assert kernels.get_kernel() == "theirs" and ours is not kernels and not hasattr(kernels, "nn")
print(warp_neural.__file__)
sys.argv = ["step", "--json", "--crop", "64"]
runpy.run_module("warp_neural.samples.mipmap.step_01_basic_program", run_name="__main__")  # as python -m does
"""


def test_the_wheel_beside_another_package_named_kernels(site, tmp_path):
    """They share no file: any order of installing, and uninstalling either, leaves the other whole."""
    (site / "kernels").mkdir()
    (site / "kernels" / "__init__.py").write_text(OTHER_KERNELS)
    (site / "kernels" / "utils.py").write_text("def get_kernel(): return 'theirs'")
    printed = python("-c", BESIDE, path=site, cwd=tmp_path).splitlines()
    assert Path(printed[0]).is_relative_to(site)
    assert json.loads(printed[-1])["resolution"] == [64, 64]


CHECKOUT = """
import importlib, pickle, runpy, sys
from kernels.nn.mlp import make_mlp
import warp_neural.kernels.nn.mlp as real
import kernels.nn, samples.mipmap, samples.mipmap.maps, warp_neural.samples.mipmap.maps

assert make_mlp is real.make_mlp and sys.modules["kernels.nn.mlp"] is real and kernels.nn.mlp is real
assert samples.mipmap.maps is warp_neural.samples.mipmap.maps
assert real.__spec__.name == real.__name__ == make_mlp.__module__ == "warp_neural.kernels.nn.mlp"
config = samples.mipmap.maps.MaterialConfig()
assert pickle.loads(pickle.dumps(config)) == config and pickle.loads(pickle.dumps(make_mlp)) is make_mlp
assert importlib.reload(kernels.nn.mlp) is real and kernels.nn.mlp.make_mlp is not make_mlp
for name in ("kernels.nothing", "kernels.nn.nothing", "kernels.nothing.mlp"):
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        assert error.name in name and "warp_neural" not in str(error)
    else:
        raise AssertionError(name)
print(warp_neural.__file__)
sys.argv = ["samples.mipmap", "--help"]
runpy.run_module("samples.mipmap", run_name="__main__", alter_sys=True)  # as python -m does
"""


def test_a_checkout_that_is_not_installed(source, tmp_path):
    """On the path of a Python that is started elsewhere."""
    printed = python("-c", CHECKOUT, path=source, cwd=tmp_path)
    assert Path(printed.splitlines()[0]).is_relative_to(source) and "--material" in printed


def test_commands_say_nothing_before_they_run():
    """Nothing that is imported starts Warp, which would greet on stdout, where --json promises one line."""
    samples = sorted(path.parent.name for path in (ROOT / "samples").glob("*/__main__.py"))
    modules = [f"warp_neural.samples.{name}.__main__" for name in samples] + ["warp_neural.cli.commands"]
    assert len(samples) >= 7
    assert python("-c", f"import {', '.join(modules)}", path=None, cwd=ROOT) == ""
