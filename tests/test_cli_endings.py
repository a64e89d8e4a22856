"""How commands end: Ctrl-C, a closed pipe, a full device, an ASCII terminal, options out of range; what they leave."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from perf import layout, measure
from warp_neural import cli
from warp_neural.cli.printing import lines_of
from warp_neural.errors import InputError
from warp_neural.imaging.image import save_image
from warp_neural.io import files
from warp_neural.io.files import atomic_path, check_target
from warp_neural.samples.__main__ import listed
from warp_neural.samples.autodiff import step_05_normals
from warp_neural.samples.hardware_acceleration import __main__ as hardware_acceleration
from warp_neural.samples.mipmap import __main__ as mipmap
from warp_neural.samples.network import step_01_basic_network, target
from warp_neural.samples.shader_training import __main__ as shader_training
from warp_neural.samples.shader_training import step_02_simple_training
from warp_neural.train.trainer import Trainer

wp.init()  # what it has to say of the machine is no part of what is tested
ROOT = Path(__file__).resolve().parent.parent
linux = pytest.mark.skipif(sys.platform != "linux", reason="/dev/full and signals as Linux has them")


@dataclass(frozen=True, kw_only=True)
class Config(cli.TrainingConfig):
    pass


def ended(capfd, main, config, *args):
    """The exit code, what was on stdout, and the line on stderr."""
    with pytest.raises(SystemExit) as exit_info:
        cli.run(main, config, list(args))
    captured = capfd.readouterr()
    assert captured.err.count("\n") == 1
    return exit_info.value.code, captured.out, captured.err.strip()


REFUSED = [
    (mipmap.Config, "--seed -1", "--seed -1: give 0 to 4611686018427387903"),
    (mipmap.Config, "--rate nan", "--rate nan: give a number above 0"),
    (mipmap.Config, "--pairs 1000000000000", "--pairs 1000000000000: give 1 to 4096"),
    (mipmap.Config, "--pictures 0", "--pictures 0: give 1 to 4096"),
    (target.Config, f"--steps {10**30}", f"--steps {10**30}: give 1 to 10000000"),
    (target.Config, "--batch 1000000000000", "--batch 1000000000000: give a multiple of 4096 to 16777216"),
    (target.Config, "--rate inf", "--rate inf: give a number above 0"),
    (step_05_normals.Config, "--size 1000000", "--size 1000000: give 8 to 4096"),
    (hardware_acceleration.Config, "--latents 100000", "--latents 100000: give 1 to 4096"),
    (shader_training.Config, "--base-color 0 nan 0", "--base-color 0.0 nan 0.0: give 0 to 1"),
    (step_02_simple_training.Config, "--scale 0", "--scale 0.0: give a number above 0"),
    (measure.Config, "--rounds 0", "--rounds 0: give 1 to 10000"),
    (measure.Config, "--record --quick", "--record: keeps whole measurements"),
    (Config, "--resume", "--resume: out has no checkpoints of a run that was stopped; leave it out"),
]


@pytest.mark.parametrize(("config", "options", "message"), REFUSED, ids=lambda value: str(value)[:30])
def test_bad_options_are_refused_before_the_work(tmp_path, monkeypatch, capfd, config, options, message):
    monkeypatch.chdir(tmp_path)
    code, out, line = ended(capfd, pytest.fail, config, *options.split())
    assert (code, out) == (2, "") and line.startswith(f"error: {message}")
    assert not list(tmp_path.iterdir())


def test_an_out_that_cannot_be_written_fails_before_the_work(tmp_path, capfd):
    (tmp_path / "file").write_text("in the way")
    code, _out, line = ended(capfd, pytest.fail, Config, "--out", str(tmp_path / "file" / "out"))
    assert code == 2 and "cannot write here" in line


def write(folder, name, text):
    with atomic_path(folder / name) as path:
        path.write_text(text)


ENDS = [
    (KeyboardInterrupt(), 130, "stopped; go on with: "),
    (InputError("a.png: truncated"), 2, "error: a.png: truncated"),
    (MemoryError(), 1, "error: not enough memory"),
    (RuntimeError("no kernel\nimage"), 1, "error: RuntimeError: no kernel image (python -X dev shows where)"),
    (OSError(28, "No space left on device", "scratch"), 1, "error: scratch: No space left on device"),
]


@pytest.mark.parametrize(("error", "code", "message"), ENDS, ids=lambda value: type(value).__name__)
def test_a_command_that_fails_leaves_what_was_there(tmp_path, capfd, error, code, message):
    """Stopped, its checkpoints too."""
    (tmp_path / "old.txt").write_text("old")

    def main(config):
        write(tmp_path, "old.txt", "new")
        write(tmp_path, "old.txt", "newer")
        write(tmp_path / "a" / "b", "new.txt", "new")
        write(tmp_path / "checkpoints", "network.safetensors", "state")
        raise error

    found, _out, line = ended(capfd, main, Config, "--out", str(tmp_path))
    assert found == code and line.startswith(message)
    left = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")}
    stopped = {"checkpoints", "checkpoints/network.safetensors"} if code == 130 else set()
    assert left == {"old.txt"} | stopped and (tmp_path / "old.txt").read_text() == "old"


def test_files_are_named_and_no_checkpoints_stay(tmp_path, capfd):
    def main(config):
        write(tmp_path, "a.txt", "a")
        write(tmp_path / "b", "c.txt", "c")
        write(tmp_path / "checkpoints", "network.safetensors", "state")
        return {"steps": 3, "levels": [{"size": 4, "error": 0.25}], "best": {"psnr": [1.0, 2.5]}}

    cli.run(main, Config, ["--out", str(tmp_path)])
    lines = capfd.readouterr().out.splitlines()
    assert lines[-2:] == [f"made in {tmp_path}: a.txt", f"made in {tmp_path / 'b'}: c.txt"]
    assert {path.name for path in tmp_path.rglob("*")} == {"a.txt", "b", "c.txt"}
    cli.run(main, Config, ["--out", str(tmp_path), "--json"])
    assert json.loads(capfd.readouterr().out)["steps"] == 3


def test_metrics_are_no_dictionaries():
    rows = [{"level": 1, "error": 0.5}, {"level": 10, "error": 0.25}]
    lines = lines_of({"levels": rows, "networks": {"plain": {"psnr": 20.0}}, "terms": [0.1, 2.0], "none": []})
    assert [line.split() for line in lines[:3]] == [["level", "error"], ["1", "0.5"], ["10", "0.25"]]
    assert [" ".join(line.split()) for line in lines[3:]] == ["networks plain psnr 20", "terms 0.1 2", "none none"]


def test_a_stopped_sample_goes_on_as_if_it_had_not_been(tmp_path, monkeypatch, capfd):
    save_image(tmp_path / "image.png", np.random.default_rng(0).random((16, 16, 3)))
    options = f"--device cpu --steps 100 --image {tmp_path}/image.png --out {tmp_path}/out --json".split()
    whole = cli.run(step_01_basic_network.main, target.Config, options)
    check = Trainer._check

    def stop(trainer):
        check(trainer)
        if trainer.index == 64:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "_check", stop)
        patch.setattr(sys, "argv", ["sample.py", "--steps", "100"])
        capfd.readouterr()
        code, _out, line = ended(capfd, step_01_basic_network.main, target.Config, *options)
    assert code == 130 and line.startswith("stopped; go on with: ") and line.endswith(" --steps 100 --resume")
    resumed = cli.run(step_01_basic_network.main, target.Config, [*options, "--resume"])
    assert resumed["psnr_step_01"] == whole["psnr_step_01"]
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["step_01.png"]


def test_what_a_killed_save_leaves_goes_with_the_next(tmp_path):
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    for number in (process.pid, os.getpid()):
        (tmp_path / f"{files._HOST}{number}-abc.json").write_text("half")
    (tmp_path / ".mine.json").write_text("mine")
    write(tmp_path, "a.json", "{}")
    assert {path.name for path in tmp_path.iterdir()} == {
        "a.json",
        ".mine.json",
        f"{files._HOST}{os.getpid()}-abc.json",
    }


def test_a_target_can_be_tried_and_nothing_is_left(tmp_path):
    check_target(tmp_path / "new" / "net.safetensors")
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="a folder or device"):
        check_target(tmp_path)


def test_measurements_replace_no_results_that_are_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bench = measure.Bench(layout.__name__, measure.Config(device="cpu", quick=True))
    bench.add("row", "column", 1.0, "ms")
    from matplotlib.figure import Figure

    path = Path(bench.finish(lambda result: Figure())["results"])
    assert path.parent.parent == Path("out/perf") and path.is_file()


def command(*args, **options):
    environment = os.environ | options.pop("env", {})
    return subprocess.Popen([sys.executable, "-m", *args], cwd=ROOT, env=environment, stderr=subprocess.PIPE, **options)


def errors_of(process):
    """Without what Warp says of a machine that has no GPU."""
    lines = process.communicate()[1].decode().splitlines()
    return [line for line in lines if not line.startswith("Warp CUDA warning")]


@linux
def test_a_pipe_that_is_closed_is_no_error():
    process = command("samples.autodiff.step_01_forward", "--device", "cpu", stdout=subprocess.PIPE)
    process.stdout.close()
    assert errors_of(process) == [] and process.returncode == 141


@linux
def test_a_full_device_is_one_line_and_a_terminal_may_lack_signs():
    full = command("samples.autodiff.step_01_forward", "--device", "cpu", stdout=os.open("/dev/full", os.O_WRONLY))
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"}
    with_ascii = command("samples.autodiff.step_01_forward", "--device", "cpu", env=plain, stdout=subprocess.PIPE)
    assert errors_of(full) == ["error: output: No space left on device"] and full.returncode == 1
    out, _err = with_ascii.communicate()
    assert with_ascii.returncode == 0 and b"dsquare/dx dx" in out


@linux
def test_ctrl_c_while_a_command_starts_is_one_line():
    process = command("samples.network")
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.3)
    process.send_signal(signal.SIGINT)
    assert errors_of(process) == ["stopped"] and process.returncode == 130


@linux
def test_a_cache_that_cannot_be_written_is_named():
    process = command("samples.mipmap", env={"WARP_CACHE_PATH": "/dev/null/x"})
    (line,) = errors_of(process)
    assert process.returncode == 2 and "/dev/null/x: no kernels" in line and "WARP_CACHE_PATH" in line


def test_samples_are_listed():
    lines = "\n".join(listed("python -m samples")).splitlines()
    assert {"python -m samples.mipmap", "python -m samples.network.step_05_latent_texture"} <= set(lines)
    assert len(lines) == 2 * len([*(ROOT / "samples").glob("*/__main__.py"), *(ROOT / "samples").glob("*/step_*.py")])
