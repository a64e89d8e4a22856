"""The command `warp-neural`: what it says of each file, conversions there and back, one line for bad input."""

import errno
import importlib
import json
import os
import tomllib
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from command_line import refused, run

from warp_neural import MLP, InputError, __version__
from warp_neural.cli.commands import main
from warp_neural.coopvec.combinations import supported_combinations
from warp_neural.io.rtxns import RtxnsNetwork
from warp_neural.io.rtxns_json import write_json
from warp_neural.io.tensors import save_tensors
from warp_neural.kernels.nn import activations, encodings
from warp_neural.kernels.nn.spec import NetworkSpec
from warp_neural.nn.convert import Form, load_rtxns, read_rtxns, save_rtxns
from warp_neural.nn.network_file import read_state, write_state
from warp_neural.nn.state import NetworkState


def data(sizes=(6, 8, 8, 2), count=1, **options):
    """Halves, which every form holds exactly."""
    rng, lead, spec = np.random.default_rng(0), (count,) if count > 1 else (), NetworkSpec(sizes)
    weights = [rng.integers(-9, 9, (*lead, n, k)).astype(np.float32) / 2 for k, n in spec.layers]
    biases = [rng.integers(-9, 9, (*lead, n)).astype(np.float32) / 2 for _, n in spec.layers]
    return NetworkState.of_layers(spec, weights, biases, count, **options)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_state("net.safetensors", data(extra={"by": "us"}))
    return tmp_path


def test_conversions_there_and_back_keep_every_value(folder, capfd):
    run(capfd, "convert", "net.safetensors", "a.ns.bin")
    run(capfd, "convert", "a.ns.bin", "b.json")
    run(capfd, "convert", "b.json", "c.bin", "--precision", "float32", "--column-major")
    run(capfd, "convert", "c.bin", "d.safetensors", "--output-activation", "linear")
    before, after = read_state("net.safetensors"), read_state("d.safetensors")
    assert after.spec == before.spec
    for a, b in zip(before.weights + before.biases, after.weights + after.biases, strict=True):
        assert (a == b).all()


def test_json_keeps_its_other_keys_through_safetensors(folder, capfd):
    run(capfd, "convert", "net.safetensors", "a.json")
    run(capfd, "convert", "a.json", "b.safetensors", "--activation", "tanh")
    run(capfd, "convert", "b.safetensors", "c.json")
    assert json.loads(Path("c.json").read_text()) == json.loads(Path("a.json").read_text())
    assert json.loads(Path("c.json").read_text())["by"] == "us"
    spec = read_state("b.safetensors").spec
    assert (spec.activation, spec.output_activation) == (activations.tanh, activations.exponential)


def test_converting_tells_what_is_lost(folder, capfd):
    net = data(encoding=encodings.Frequency(3), n_in=1)
    weights = [w.copy() for w in net.weights]
    weights[0][0, 0] = 0.1
    net = net.with_layers(weights)
    write_state("encoded.safetensors", net)
    told = run(capfd, "convert", "encoded.safetensors", "a.bin")
    frequency = {"name": "Frequency", "octaves": 3, "lowest": 1.0}
    assert told["left_out"] == {"activation": "relu", "output_activation": "linear", "encoding": frequency}
    assert told["largest_rounding"] == abs(float(np.float16(0.1)) - float(np.float32(0.1)))
    assert run(capfd, "convert", "encoded.safetensors", "a.bin", "--precision", "float32")["largest_rounding"] == 0


def test_info_describes_each_form_whatever_its_name(folder, capfd):
    run(capfd, "convert", "net.safetensors", "a.bin")
    run(capfd, "convert", "net.safetensors", "a.json")
    said = {}
    for name, form in (("net.safetensors", "safetensors"), ("a.bin", "rtxns_binary"), ("a.json", "rtxns_json")):
        Path(name).rename("unnamed")
        said[form] = run(capfd, "info", "unnamed")
        assert said[form]["format"] == form
        assert said[form]["sizes"] == [6, 8, 8, 2] and said[form]["parameters"] == 56 + 72 + 18
        weights = data().weights[1]
        assert said[form]["weights_1"] == [weights.min(), weights.max()]
    assert said["safetensors"]["activation"] == "relu" and said["rtxns_json"]["activation"] is None
    assert said["rtxns_binary"]["precision"] == "float16" and said["rtxns_json"]["extra"] == {"by": "us"}


def test_info_tells_what_a_checkpoint_holds(folder, capfd):
    tensors = {"first": np.array([[1.0, np.nan]]), "none": np.zeros((0, 2), np.float16), "\x1b[31m": np.array([2, -3])}
    save_tensors("c.safetensors", tensors, {"format": "checkpoint", "step": 7, "loss": float("inf")})
    said = run(capfd, "info", "c.safetensors")
    assert said["metadata"] == {"format": "checkpoint", "step": 7, "loss": "Infinity"} and said["values"] == 4
    assert said["tensors"]["first"] == {"type": "float64", "shape": [1, 2], "range": None}
    assert said["tensors"]["\x1b[31m"]["range"] == [-3, 2]
    main(["info", "c.safetensors"])
    text = capfd.readouterr().out
    assert "'first'                  float64 [1, 2] None" in text and "\x1b" not in text


def test_devices_lists_what_runs_where(capfd):
    said = run(capfd, "devices")["devices"]
    assert list(said) == [device.alias for device in wp.get_devices()]
    assert said["cpu"]["combinations"] == [vars(row) for row in supported_combinations("cpu")]
    main(["devices"])
    text = capfd.readouterr().out
    assert text.startswith("devices ") and "| float16    | e4m3 " in text
    main(["--version"])
    assert capfd.readouterr().out == f"warp-neural {__version__}\n"


BAD = {
    "missing": (["info", "none.bin"], "none.bin: no such file"),
    "unknown": (["info", "notes.txt"], "neither safetensors nor a network of RTXNS"),
    "suffix": (["convert", "net.safetensors", "a.onnx"], "a.onnx: unknown suffix; use .safetensors, .bin, .json"),
    "no options": (["convert", "net.safetensors", "a.bin", "--activation", "relu"], "hold no activations"),
    "several": (["convert", "several.safetensors", "a.bin"], "a.bin: 3 networks, RTXNS's files hold one"),
    "latent": (["convert", "latent.safetensors", "a.json"], "cannot hold the parameters of LatentTexture"),
    "checkpoint": (["convert", "checkpoint.safetensors", "a.bin"], "format 'checkpoint', not a network"),
    "large": (["convert", "large.json", "a.safetensors"], r"large.json: sizes (300, 1)"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_exit_code_2(folder, capfd, case):
    Path("notes.txt").write_text("no network")
    write_state("several.safetensors", data(count=3))
    latent = encodings.LatentTexture(2, 2, channels=6)
    write_state("latent.safetensors", data(encoding=latent, n_in=2))
    save_tensors("checkpoint.safetensors", {}, {"format": "checkpoint"})
    write_json("large.json", RtxnsNetwork([np.zeros((1, 300))], [np.zeros(1)]))
    before = sorted(folder.iterdir())
    args, message = BAD[case]
    assert message in refused(capfd, *args)
    assert sorted(folder.iterdir()) == before


def test_shells_complete_the_command(capfd):
    for shell in ("bash", "zsh"):
        with pytest.raises(SystemExit) as exit_info:
            main(["--tyro-print-completion", shell])
        assert not exit_info.value.code
        text = capfd.readouterr().out
        assert all(word in text for word in ("info", "convert", "devices", "column-major", "leaky_relu"))
        assert {"bash": "complete -o default -F", "zsh": "|| _files"}[shell] in text  # names of files
        assert "warp-neural" in text


def test_the_package_installs_the_command():
    project = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text())["project"]
    module, name = project["scripts"]["warp-neural"].split(":")
    assert getattr(importlib.import_module(module), name) is main


@pytest.mark.parametrize("name", ["net.ns.bin", "net.json"])
def test_an_mlp_goes_to_rtxns_and_back(tmp_path, device, name):
    options = {"encoding": encodings.Frequency(3), "output_activation": activations.exponential, "device": device}
    net = MLP(5, 4, 16, 2, **options)
    net.biases = [np.full_like(biases, 0.25) for biases in net.biases]
    save_rtxns(tmp_path / name, net)
    loaded = load_rtxns(tmp_path / name, n_in=5, encoding=encodings.Frequency(3), device=device)
    assert (loaded.spec, loaded.encoding, loaded.n_in) == (net.spec, net.encoding, net.n_in)
    assert (loaded.packed.numpy() == net.packed.numpy()).all()  # float16, as the file
    with pytest.raises(InputError, match="takes 30 inputs; give an encoding with as many results of n_in inputs"):
        load_rtxns(tmp_path / name, n_in=4, encoding=encodings.Frequency(3), device=device)
    assert load_rtxns(tmp_path / name, n_in=30, device=device).n_in == 30
    with pytest.raises(InputError, match=f"{name}: takes 30 inputs, not n_in=3; leave n_in out, or give an encoding"):
        load_rtxns(tmp_path / name, n_in=3, device=device)
    assert read_rtxns(tmp_path / name).sizes == (30, 16, 16, 4)


@pytest.mark.parametrize(
    ("content", "form"),
    [
        (b"\x01\xde\xc0\xa1", Form.RTXNS_BINARY),
        (b"\x02\xde\xc0\xa1", Form.RTXNS_BINARY),  # of another version
        (b" \n\t{", Form.RTXNS_JSON),
        (b'\xef\xbb\xbf{"layers": []}', Form.RTXNS_JSON),
        (b"\2\0\0\0\0\0\0\0{}", Form.SAFETENSORS),
        (b"", None),
        (b"\xff" * 9, None),
        (b"\xff\0\0\0\0\0\0\0{}", None),  # a header longer than the file
    ],
)
def test_forms_are_told_apart_by_content(tmp_path, content, form):
    (tmp_path / "a").write_bytes(content)
    if form:
        assert Form.of_file(tmp_path / "a") is form
    else:
        with pytest.raises(InputError, match="neither safetensors nor"):
            Form.of_file(tmp_path / "a")


@pytest.mark.parametrize("name", ["a.safetensors", "a.bin", "a.json"])
def test_a_full_disk_leaves_the_old_file(folder, capfd, monkeypatch, name):
    Path(name).write_text("old")

    def write(self, data):
        with open(self, "wb") as file:
            file.write(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", write)
    assert refused(capfd, "convert", "net.safetensors", name) == (
        f"error: {name}: could not be written (No space left on device); nothing was changed\n"
    )
    assert Path(name).read_text() == "old" and {path.name for path in folder.iterdir()} == {"net.safetensors", name}
