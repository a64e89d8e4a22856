"""The network and hardware-acceleration sections at toy size: every step and both main jobs."""

import json

import numpy as np
import pytest

from warp_neural import cli
from warp_neural.errors import InputError
from warp_neural.imaging.image import load_image, save_image
from warp_neural.samples.hardware_acceleration import __main__ as hardware_acceleration
from warp_neural.samples.hardware_acceleration.picture import load_picture
from warp_neural.samples.network import __main__ as network
from warp_neural.samples.network import (
    step_01_basic_network,
    step_02_multiple_layers,
    step_03_activations,
    step_04_frequency_encoding,
    step_05_latent_texture,
)
from warp_neural.samples.network.target import Config, load_target, psnr

STEPS = [
    step_01_basic_network,
    step_02_multiple_layers,
    step_03_activations,
    step_04_frequency_encoding,
    step_05_latent_texture,
]
PARAMETERS = [9, 1251, 1251, 1699, 1315 + 4096]


@pytest.fixture
def disc(tmp_path):
    """An orange disc on teal, 64 x 64."""
    i, j = np.mgrid[:64, :64]
    inside = (i - 31.5) ** 2 + (j - 31.5) ** 2 < 20**2
    save_image(tmp_path / "disc.png", np.where(inside[..., None], [0.9, 0.2, 0.03], [0.02, 0.3, 0.4]))
    return tmp_path / "disc.png"


def test_network_steps(device, tmp_path, disc):
    config = Config(device=device.alias, out=tmp_path, json=True, image=disc, steps=200)
    for number, (step, parameters) in enumerate(zip(STEPS, PARAMETERS, strict=True), start=1):
        name = f"step_0{number}"
        metrics = step.main(config)
        assert metrics[f"parameters_{name}"] == parameters and metrics[f"seconds_{name}"] > 0
        picture = load_image(tmp_path / f"{name}.png")
        assert picture.shape == (64, 128, 3)
        shown = psnr(picture[:, 64:], load_target(config))
        assert metrics[f"psnr_{name}"] == pytest.approx(shown, abs=0.1)
        assert shown > (10, 8, 12, 20, 28)[number - 1]  # an output of step 2 may be dead


def test_network(device, tmp_path, capfd):
    options = f"--device {device.alias} --out {tmp_path} --json --steps 2"
    cli.run(network.main, Config, options.split())
    metrics = json.loads(capfd.readouterr().out)
    for k, parameters in enumerate(PARAMETERS, start=1):
        assert metrics[f"parameters_step_0{k}"] == parameters and metrics[f"psnr_step_0{k}"] > 0
    assert [metrics[f"parameters_{name}"] for name in ("3x32", "3x64", "4x64")] == [2307, 8707, 12867]
    assert metrics["resolution"] == [256, 256] and metrics["seconds_total"] > 0
    assert load_image(tmp_path / "comparison.png").std() > 0.1


def test_psnr():
    grey = np.full((2, 2, 3), 0.5)
    assert psnr(grey, grey) == 120
    assert psnr(np.zeros((2, 2, 3)), np.ones((2, 2, 3))) == 0
    assert psnr(grey, np.concatenate([grey[:1], 0 * grey[:1]])) == pytest.approx(20 * np.log10(255 / 188) + 3.0103)


def test_targets(tmp_path):
    save_image(tmp_path / "grey.png", np.linspace(0, 1, 12).reshape(3, 4))
    save_image(tmp_path / "alpha.png", np.full((3, 4, 4), 0.5))
    for name in ("grey", "alpha"):
        assert load_target(Config(image=tmp_path / f"{name}.png")).shape == (3, 4, 3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"steps": 0}, "--steps 0"),
        ({"rate": float("inf")}, "--rate inf"),
        ({"batch": 100}, "--batch 100: give a multiple of 4096"),
        ({"image": "missing.png"}, "missing.png"),
    ],
)
def test_bad_network_options(tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=message):
        network.main(Config(device="cpu", json=True, **options))


def test_hardware_acceleration(device, tmp_path):
    sizes = {"side": 64, "small_steps": 300, "small_batch": 256, "latents": 16, "batch": 256, "short": 34, "steps": 300}
    config = hardware_acceleration.Config(device=device.alias, out=tmp_path, json=True, **sizes)
    metrics = hardware_acceleration.main(config)
    close = 0.02 if device.is_cuda else 1e-4  # float16 there
    for name in ("per_thread", "tiled", "cooperative"):
        assert metrics[f"small_milliseconds_{name}"] > 0
        assert metrics[f"small_error_{name}"] < 0.3 and metrics[f"small_difference_{name}"] < close
    short = [metrics[f"texture_psnr_short_{name}"] for name in ("per_thread", "unfused", "float32", "float16")]
    assert max(short) - min(short) < 0.1
    assert metrics["texture_psnr_float32"] > short[0] + 1
    assert abs(metrics["texture_psnr_float16"] - metrics["texture_psnr_float32"]) < 0.3
    assert metrics["texture_speedup_float16"] > 0
    assert load_image(tmp_path / "crops.png").shape == (64, 192, 3) and load_image(tmp_path / "times.png").std() > 0.05


def test_pictures(tmp_path):
    tiles = load_picture(None, 1100, 0)
    assert tiles.shape == (1100, 1100, 3) and tiles.dtype == np.uint8 and tiles.std() > 30
    assert (tiles == load_picture(None, 1100, 0)).all() and (tiles != load_picture(None, 1100, 1)).any()
    codes = np.arange(24, dtype=np.uint8).reshape(2, 4, 3) * 10
    save_image(tmp_path / "codes.png", codes / 255, color_space="linear")
    assert (load_picture(tmp_path / "codes.png", 0, 0) == codes).all()


@pytest.mark.parametrize("options", [{"steps": 1}, {"short": -1}, {"small_steps": 0}, {"side": 0}, {"batch": -3}])
def test_bad_hardware_options(tmp_path, options):
    (option,) = options
    with pytest.raises(InputError, match=f"--{option.replace('_', '-')} {options[option]}"):
        hardware_acceleration.main(hardware_acceleration.Config(device="cpu", out=tmp_path, json=True, **options))
