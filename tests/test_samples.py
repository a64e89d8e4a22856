"""Every sample runs at toy size and gets done what it is for."""

import json
from dataclasses import replace

import pytest
import warp as wp

from warp_neural.errors import InputError
from warp_neural.imaging.exr import load_exr
from warp_neural.imaging.exr_mips import load_exr_mips
from warp_neural.imaging.image import load_image
from warp_neural.materials.material import find_maps
from warp_neural.samples.mipmap import __main__ as mipmap
from warp_neural.samples.mipmap import (
    step_01_basic_program,
    step_02_downsampled_inputs,
    step_03_reference,
    step_04_loss,
    step_05_train,
)
from warp_neural.samples.mipmap.maps import MaterialConfig


@pytest.fixture
def common(device, tmp_path):
    return {"device": device.alias, "out": tmp_path, "crop": 64, "json": True}


def test_mipmap_steps(common, tmp_path):
    config = MaterialConfig(**common)
    first = step_01_basic_program.main(config)
    second = step_02_downsampled_inputs.main(config)
    third = step_03_reference.main(config)
    fourth = step_04_loss.main(config)
    fifth = step_05_train.main(step_05_train.Config(**common, steps=1500))
    assert first["resolution"] == [64, 64] and fourth["resolution"] == [16, 16]
    assert first["mean_radiance"] == pytest.approx(second["mean_radiance_full"])
    assert third["mean_radiance_reference"] == pytest.approx(first["mean_radiance"], rel=1e-4)
    assert fourth["loss"] == pytest.approx(fifth["loss_filtered"], rel=1e-4)
    assert fifth["loss_learned"] < 0.7 * fifth["loss_filtered"]
    for step, width in ((1, 64), (2, 128), (3, 128), (4, 192), (5, 192)):
        picture = load_image(tmp_path / f"step_0{step}.png")
        assert picture.shape == (64, width, 3) and picture.std() > 0.01


def test_mipmap(common, tmp_path):
    metrics = mipmap.main(mipmap.Config(**common, steps=150, judge_pairs=1024, pictures=4, levels=3))
    best = min(metrics["display_box"], metrics["display_toksvig"])
    assert metrics["display_adam"] < 0.9 * best < metrics["display_sgd"]
    assert metrics["linear_adam"] < min(metrics["linear_box"] / 3, 1.1 * metrics["linear_toksvig"])
    assert metrics["linear_adam"] < metrics["linear_sgd"]
    assert metrics["psnr_adam"] > metrics["psnr_sgd"] and 0 < metrics["flip_adam"] < 1
    assert (metrics["iterations"], metrics["resolution"]) == (150, [16, 16])
    assert metrics["seconds_total"] > metrics["seconds_train"] > 0

    saved = json.loads((tmp_path / "metrics.json").read_text())
    assert saved == metrics
    assert json.loads((tmp_path / "config.json").read_text())["steps"] == 150
    assert load_image(tmp_path / "comparison.png").std() > 0.1 and load_image(tmp_path / "curves.png").std() > 0.05
    assert {"albedo", "normal", "roughness", "metalness"} <= set(find_maps(tmp_path / "learned"))
    assert load_exr(tmp_path / "learned" / "maps.exr")["specular"].shape == (16, 16)

    chain = load_exr_mips(tmp_path / "chain" / "chain.exr")
    assert [level["roughness"].shape[0] for level in chain] == [64, 32, 16, 8, 4, 2, 1]
    assert [row["size"] for row in metrics["levels"]] == [32, 16, 8]
    for row in metrics["levels"]:
        assert row["display_adam"] < min(row["display_box"], row["display_toksvig"])


def test_sweep(common, tmp_path, monkeypatch):
    monkeypatch.setattr("warp_neural.samples.mipmap.sweep.RATES", {mipmap.SGD: [1e-6, 1e3], mipmap.Adam: [1e-2, 10.0]})
    best = mipmap.main(mipmap.Config(**{**common, "crop": 32}, steps=20, judge_pairs=1024, sweep=True))
    assert best["rate_ours_adam"] == 1e-2 and best["linear_ours_adam"] < best["linear_course_sgd"]
    assert len(json.loads((tmp_path / "sweep.json").read_text())) == 8


def test_the_same_seed_gives_the_same_metrics(common):
    config = mipmap.Config(**{**common, "crop": 32}, steps=5, judge_pairs=64, pictures=1)
    runs = [mipmap.main(c) for c in (config, config, replace(config, seed=1))]
    keys = [key for key in runs[0] if key.startswith(("linear", "display", "psnr", "flip"))]
    assert [runs[0][key] for key in keys] == [runs[1][key] for key in keys]
    assert runs[0]["linear_adam"] != runs[2]["linear_adam"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"steps": 0}, "--steps 0"),
        ({"pairs": 0}, "--pairs 0"),
        ({"judge_pairs": -1}, "--judge-pairs -1"),
        ({"rate": 0.0}, "--rate 0.0"),
        ({"levels": -1}, "--levels -1"),
        ({"crop": 60, "levels": 2, "steps": 1, "judge_pairs": 16, "pictures": 1}, "power of two"),
    ],
)
def test_bad_options(tmp_path, options, message):
    with pytest.raises(InputError, match=message):
        mipmap.main(mipmap.Config(**{"device": "cpu", "out": tmp_path, "crop": 64, "json": True, **options}))


def test_unwritable_out(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="cannot write here"):
        mipmap.main(mipmap.Config(device="cpu", out=tmp_path / "file" / "out", crop=64, json=True))


@pytest.mark.skipif(wp.is_cuda_available(), reason="this machine has CUDA")
def test_cuda_without_cuda(tmp_path):
    with pytest.raises(InputError, match="--device cuda"):
        mipmap.main(mipmap.Config(device="cuda", out=tmp_path))
