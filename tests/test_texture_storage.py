"""`perf.texture_storage` at toy size: textures of both storages beside block formats."""

from importlib.util import find_spec

import numpy as np
import pytest

from perf import recorded, texture_storage
from perf.results import load_all
from warp_neural.imaging.image import load_image, save_image
from warp_neural.texture import compression
from warp_neural.texture.presets import Effort

PEERS = "etcpak", "quicktex", "texture2ddecoder", "zstandard"


@pytest.mark.skipif(not all(map(find_spec, PEERS)), reason="pip install -e '.[peers]'")
def test_command(tmp_path, monkeypatch):
    """Files that are made and then given; bits in memory, in files, and how far ahead."""
    pixels = np.clip(0.5 + 0.3 * np.sin(np.arange(32) / 4)[:, None, None] * np.ones((32, 32, 3)), 0, 1)
    save_image(tmp_path / "some" / "albedo.png", pixels * [1, 0.8, 0.5], color_space="linear")
    save_image(tmp_path / "some" / "roughness.png", pixels[..., :1] ** 2, color_space="linear")
    monkeypatch.setattr(compression, "effort_of", lambda device, preview, texels: Effort(100, 1))
    monkeypatch.setitem(recorded.RTXNTC, "some", [(1.26, 5.0)])
    common = {"material": tmp_path / "some", "device": "cpu", "json": True, "kept": tmp_path / "kept"}
    metrics = texture_storage.main(texture_storage.StorageConfig(quick=True, out=tmp_path / "out", **common))
    result = load_all(tmp_path / "out")["texture_storage_some"]
    sample, engine = (result.find("bits in memory", column).value for column in ("sample 1.06", "engine 5.00"))
    assert (sample, engine) == (1.0625, 5)
    assert result.find("bits in memory", "BC1, BC4").value == 8
    ahead, psnr = (result.find(row, "sample 1.06").value for row in ("ahead: PSNR", "PSNR"))
    assert ahead == psnr - 5 and psnr > 8
    flips = [result.find(f"{name} FLIP", "engine 5.00").value for name in ("albedo", "roughness")]
    assert result.find("FLIP", "engine 5.00").value == pytest.approx(np.mean(flips)) and min(flips) > 0
    files = sorted((tmp_path / "kept" / "some").iterdir())
    assert len(files) == 7  # a file for sampling, a network and five latent textures
    stored = 8 * sum(path.stat().st_size for path in files[:6]) / 32**2
    assert 0 < result.find("bits in files", "engine 5.00").value < stored
    assert load_image(tmp_path / "out" / "texture_storage_some.png").std() > 0.05
    given = tuple(path for path in files if path.suffix in (".wntc", ".safetensors"))
    again = texture_storage.StorageConfig(files=given, made_on="a card", out=tmp_path / "again", **common)
    assert texture_storage.main(again) == metrics
