"""Steps 2 and 3 of the textured scene at toy size: costs are told, and what is decoded is the same picture."""

from dataclasses import replace

import pytest
import warp as wp
from texture_maps import MAPS, make_texture

from warp_neural.errors import InputError
from warp_neural.imaging.block_files import load_blocks
from warp_neural.imaging.image import load_image
from warp_neural.samples.textured_scene import step_02_on_load, step_03_on_feedback


@pytest.fixture
def common(device, tmp_path):
    wp.init()
    maps = (*MAPS[:2], replace(MAPS[2], name="roughness"))
    make_texture(device, height=96, width=128, mips=8, maps=maps).save(tmp_path / "a.wntc")
    return {"device": device.alias, "out": tmp_path, "texture": tmp_path / "a.wntc", "width": 48, "json": True}


def test_on_load(common, tmp_path):
    metrics = step_02_on_load.main(step_02_on_load.Config(**common, frames=2))
    assert metrics["flip_on_sample"] == 0 < metrics["flip_codes"] < 0.02 < metrics["flip_bc7"] < metrics["flip_bc1"]
    assert metrics["bytes_bc1"] < metrics["bytes_bc7"] < metrics["bytes_codes"]
    assert all(metrics[f"milliseconds_{name}"] > 0 for name in ("on_sample", "codes", "bc7", "bc1"))
    for name, format in (("albedo", "bc7"), ("normal", "bc5"), ("roughness", "bc4")):
        files = [load_blocks(tmp_path / "blocks" / f"{name}.{file}") for file in ("dds", "ktx2")]
        assert files[0].levels == files[1].levels and files[0].format == format and len(files[0].levels) == 8
    assert load_image(tmp_path / "step_02.png").std() > 0.05


def test_on_feedback(common, tmp_path):
    metrics = step_03_on_feedback.main(step_03_on_feedback.FeedbackConfig(**common | {"width": 120}, frames=3, tile=8))
    assert metrics["different_pixels"] == 0 and metrics["flip_on_feedback"] == metrics["flip_on_load"]
    assert metrics["misses_on_feedback"] == metrics["decodes_on_feedback"] > 20
    assert metrics["misses_under_pressure"] > metrics["misses_on_feedback"]
    assert metrics["bytes_under_pressure"] <= metrics["bytes_on_feedback"] / 4
    assert metrics["flip_under_pressure"] > metrics["flip_on_feedback"]
    assert load_image(tmp_path / "step_03.png").std() > 0.05


def test_a_cache_without_place_is_refused(common):
    with pytest.raises(InputError, match="budget=1000: 6 tiles, the least, take"):
        step_03_on_feedback.main(step_03_on_feedback.FeedbackConfig(**common, frames=1, tile=16, budget=1000))
