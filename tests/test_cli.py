"""The common command line: devices, `--json`, errors as one line with exit code 2, files whole or not at all."""

import json
import os
from dataclasses import dataclass

import pytest
import warp as wp

from warp_neural.cli import CommonConfig, resolve_device, run
from warp_neural.errors import InputError
from warp_neural.io.files import atomic_path


@dataclass(frozen=True)
class Config(CommonConfig):
    steps: int = 3


def test_json_is_the_only_thing_on_stdout(capfd):
    def main(config):
        print("noise")
        return {"steps": config.steps}

    assert run(main, Config, ["--json", "--steps", "5"]) == {"steps": 5}
    captured = capfd.readouterr()
    assert json.loads(captured.out) == {"steps": 5}
    assert "noise" in captured.err


def test_input_error_is_one_line_and_exit_code_2(capfd):
    def main(config):
        raise InputError("albedo.png: truncated; save it again")

    with pytest.raises(SystemExit) as exit_info:
        run(main, Config, [])
    assert exit_info.value.code == 2
    assert capfd.readouterr().err == "error: albedo.png: truncated; save it again\n"


@pytest.mark.skipif(wp.is_cuda_available(), reason="this machine has CUDA")
def test_cuda_without_cuda_is_an_input_error():
    with pytest.raises(InputError, match="--device cuda: no such device; this machine has cpu"):
        resolve_device("cuda")


@pytest.mark.parametrize("name", ["gpu", "cuda:99", "cpu:1", ""])
def test_unknown_device_is_an_input_error(name):
    with pytest.raises(InputError, match=f"--device {name}"):
        resolve_device(name)


def test_auto_prefers_cuda():
    assert resolve_device("auto").is_cuda == wp.is_cuda_available()


def test_a_failed_write_leaves_the_old_file(tmp_path):
    target = tmp_path / "new" / "file.txt"
    with atomic_path(target) as temporary:
        temporary.write_text("first")
    with pytest.raises(RuntimeError), atomic_path(target) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert target.read_text() == "first"
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no named pipes among its files")
def test_only_files_are_replaced(tmp_path):
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    for name in ("folder", "pipe"):
        with pytest.raises(InputError, match=f"{name}: a folder or device"), atomic_path(tmp_path / name):
            pass
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder", "pipe"]


def test_unwritable_folder_is_an_input_error(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="cannot write here"), atomic_path(tmp_path / "file" / "picture.png"):
        pass
