"""The neural-texture section at toy size: every step, what it counts, and the main job."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.errors import InputError
from warp_neural.imaging.image import load_image
from warp_neural.kernels.texture.spec import Grid
from warp_neural.samples.neural_texture import __main__ as neural_texture
from warp_neural.samples.neural_texture import (
    step_01_latent_texture,
    step_02_several_grids,
    step_03_learned_kernels,
    step_04_noise,
    step_05_straight_through,
    step_06_rate,
    step_07_context,
)
from warp_neural.samples.neural_texture.figures import gain
from warp_neural.samples.neural_texture.target import Config, load_target
from warp_neural.samples.neural_texture.texture import Point, Texture, best_step, bilinear
from warp_neural.texture import compression, presets
from warp_neural.texture.measure import psnr
from warp_neural.texture.presets import Effort

WIDTHS = step_01_latent_texture, step_02_several_grids, step_03_learned_kernels


@pytest.fixture
def config(device, tmp_path):
    return Config(device=device.alias, out=tmp_path, json=True, side=64, steps=250, batch=1024)


def test_steps_with_rounding_in_the_end(config, tmp_path):
    best = []
    for number, step in enumerate(WIDTHS, start=1):
        rows = step.main(config)[f"step_0{number}"]
        assert [row["bits_of_latent"] for row in rows] == [3, 4, 5, 8]
        assert all(a["psnr"] < b["psnr"] for a, b in pairwise(rows))
        latents = sum(grid.channels / grid.scale**2 for grid in step.GRIDS)
        assert rows[3]["bits"] - rows[1]["bits"] == pytest.approx(4 * latents, abs=0.05)
        assert load_image(tmp_path / f"step_0{number}.png").shape == (5 * 64, 128, 3)
        best.append(rows[-1]["psnr"])
    assert 27 < best[0] < best[1] < best[2] - 0.5


def test_steps_with_whole_numbers(config, tmp_path, monkeypatch):
    """At 2 bits, three levels: rounded in the end alone, with noise in training, and with the finish."""
    for step in (step_01_latent_texture, step_04_noise):
        monkeypatch.setattr(step, "BITS", (2,))
    rows = []
    for number, step in ((3, step_03_learned_kernels), (4, step_04_noise), (5, step_05_straight_through)):
        rows += step.main(config)[f"step_0{number}"]
        assert load_image(tmp_path / f"step_0{number}.png").std() > 0.1
    rounded, noisy, finished = (row["psnr"] for row in rows)
    assert rounded + 0.5 < noisy < finished - 0.5
    assert rows[1]["bits"] == pytest.approx(rows[2]["bits"], abs=0.2)


def test_steps_with_a_rate(config, tmp_path, monkeypatch):
    monkeypatch.setattr(step_06_rate, "RATE_WEIGHTS", (1e-3, 1e-5))
    few, many = step_07_context.main(config)["step_07"]
    assert few["latents_alone"] < 0.6 * many["latents_alone"] and few["psnr"] < many["psnr"]
    assert few["rate_weight"] == 1e-3
    for row in (few, many):
        path = tmp_path / f"step_07_{row['rate_weight']:g}.wntc"
        assert row["bits"] == 8 * path.stat().st_size / 64**2
        decoded = wn.texture.load(path, "cpu").decoder.decode()
        assert row["psnr"] == pytest.approx(psnr(load_target(config).values, decoded), abs=0.01)
        assert row["latents_in_file"] == pytest.approx(row["latents_alone"], rel=0.2)
        assert row["latents_by_neighbours"] == pytest.approx(row["latents_alone"], rel=0.2)
    monkeypatch.setattr(step_06_rate, "RATE_WEIGHTS", (1e-3,))
    (alone,) = step_06_rate.main(config)["step_06"]
    assert alone["psnr"] == pytest.approx(few["psnr"], abs=0.3 if config.device != "cpu" else 1e-6)


def test_neighbours_say_where_latents_are_large(device, config):
    texture = Texture((Grid(2, 4),), load_target(config), 0, device)
    whole = np.zeros((32, 32, 4), np.float32)
    whole[16:] = np.random.default_rng(0).laplace(0, 6, (16, 32, 4))
    texture.latents.assign(np.rint(whole).reshape(-1, 4))
    widths = np.linspace(0.1, 8, 100)[:, None]
    alone = laplace_bits(np.rint(whole).ravel(), widths).sum(1).min()
    assert 0.5 * alone < step_07_context.bits_by_neighbours(texture) < 0.85 * alone


def laplace_bits(q, width):
    """Of the mass between q - 1/2 and q + 1/2."""
    below, above = (np.where(x < 0, 0.5 * np.exp(x / width), 1 - 0.5 * np.exp(-x / width)) for x in (q - 0.5, q + 0.5))
    return -np.log2(above - below + 2.0**-24)


@pytest.mark.parametrize("parameter", [-2.0, 0.0, 3.0])
def test_bits(device, parameter):
    q = np.arange(-3, 4)
    read = wp.array(np.repeat(q[:, None], 4, 1), dtype=wp.vec4, device=device)
    widths = wp.full(1, value=wp.vec4(parameter), dtype=wp.vec4, device=device)
    bits = wp.empty(len(q), dtype=float, device=device)
    channels = wp.zeros(len(q), dtype=int, device=device)
    wp.launch(step_06_rate.rate_kernel, len(q), [read, channels, widths], [bits], device=device)
    expected = laplace_bits(q, 0.02 + np.log1p(np.exp(parameter)))
    np.testing.assert_allclose(bits.numpy() / 4, expected, rtol=1e-3, atol=1e-3)


def test_neural_texture(config, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(compression, "effort_of", lambda *_: Effort(300, 1))
    monkeypatch.setattr(neural_texture, "STEPS_ON_CPU", 300)
    monkeypatch.setattr(presets, "MANY", (Grid(4, 4),))
    monkeypatch.setattr(step_06_rate, "RATE_WEIGHTS", (1e-4, 3e-3))
    for step in (step_01_latent_texture, step_04_noise):
        monkeypatch.setattr(step, "BITS", (4, 2))
    options = f"--device {config.device} --out {tmp_path} --json --side 64 --steps 60 --batch 1024"
    cli.run(neural_texture.main, Config, options.split())
    metrics = json.loads(capfd.readouterr().out)
    assert json.loads((tmp_path / "metrics.json").read_text()) == metrics
    assert [row["step"] for row in metrics["points"]] == [
        idea for name, idea in neural_texture.IDEAS.items() for _ in range(1 if name == "codec" else 2)
    ]
    assert all(row["psnr"] > 15 and 0 < row["bits"] < 40 for row in metrics["points"])
    assert abs(metrics["gain_step_07"]) < 0.5 and metrics["resolution"] == [64, 64]
    assert metrics["points"][-1]["bits"] == 8 * (tmp_path / "codec.wntc").stat().st_size / 64**2
    assert load_image(tmp_path / "curves.png").std() > 0.05 and load_image(tmp_path / "crops.png").std() > 0.1


def test_gain():
    curve = [Point(bits, 3 * np.log2(bits), np.zeros(0), {}) for bits in (1, 2, 4, 8)]
    better = [replace(point, psnr=point.psnr + 1) for point in curve[1:]]
    assert gain(curve, better) == pytest.approx(1) and gain(better, curve) == pytest.approx(-1)
    assert gain(curve, [Point(4, 7, np.zeros(0), {})]) == pytest.approx(1)
    assert gain(curve[:2], better[1:]) is None


def test_steps_of_rounding():
    latents = np.array([-1.0, 1.0, 2.0, 3.0])
    assert best_step(latents, 3) == pytest.approx(1)
    assert best_step(np.append(np.random.default_rng(0).normal(size=999), 8.0), 1) < 2  # an outlier is cut off


def test_bilinear_weights():
    weights = bilinear(Grid(4, 8)).reshape(2, 4, 4, 4, 4)
    assert (weights[0] == weights[1]).all()
    assert weights.sum(3) == pytest.approx(0.3)
    assert weights[0, 3, 0, :, 0] == pytest.approx(0.3 * np.array([7, 1, 49, 7]) / 64)


@pytest.mark.parametrize(
    ("options", "message"),
    [({"side": 40}, "--side 40: give a multiple of 16"), ({"steps": 0}, "--steps 0"), ({"material": Path("no")}, "no")],
)
def test_bad_options(tmp_path, options, message):
    with pytest.raises(InputError, match=message):
        neural_texture.main(Config(device="cpu", out=tmp_path, json=True, **options))
