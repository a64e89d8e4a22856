"""`warp-neural compress`, `decompress` and `info` of textures: options, files, stopped runs."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import refused, run
from texture_codec import Exact, codec

from warp_neural import texture
from warp_neural.cli.commands import main
from warp_neural.cli.quantities import bytes_of
from warp_neural.imaging.block_files import load_blocks
from warp_neural.imaging.image import load_stored
from warp_neural.io.files import atomic_path
from warp_neural.texture.file import TextureFile
from warp_neural.texture.maps import load_set

__all__ = ["codec"]  # a fixture
GOLDEN = Path(__file__).parent / "golden" / "version_1.wntc"


def test_options_reach_the_codec(codec, capfd):
    options = ["--size", "1.5KiB", "--weights", "albedo=2, normal=0.5", "--losses", "normal=angle"]
    options += ["--mips", "all", "--seed", "7", "--preview", "--steps", "500", "--for", "sample"]
    said = run(capfd, "compress", "rock", "-o", "out/rock.wntc", "--device", "cpu", *options)
    (call,) = codec
    assert call.pop("device").alias == "cpu" and call.pop("quiet")
    assert call == {
        "bpp": None,
        "psnr": None,
        "size": 1536,
        "quality": None,
        "storage": "sample",
        "preview": True,
        "steps": 500,
        "mips": 4,
        "weights": {"albedo": 2.0, "normal": 0.5},
        "losses": {"normal": "angle"},
        "seed": 7,
        "checkpoint": Path("out/checkpoints/rock.wntc.safetensors"),
    }
    assert said["written"] == "out/rock.wntc" and said["bytes"] == 100 and said["metrics"] == {"psnr": 99.0}
    assert said["bits_per_texel"] == 800 / 54 and said["bits_per_texel_of"]["network"] == 320 / 54
    assert (said["width"], said["height"], said["mips"]) == (9, 6, 4)
    assert said["grids"] == [{"scale": 4, "channels": 2, "kernel": "learned", "bits": 8}]
    rows = {row["map"]: row for row in said["maps"]}
    assert rows["ao"] == {
        "map": "ao",
        "kind": "linear",
        "channels": 1,
        "constant": [1.0],
        "range": [1.0, 1.0],
        "bits": 8,
        "file": "ao.png",
    }
    assert rows["sky"]["kind"] == "hdr" and rows["albedo"]["constant"] == []


def test_a_missed_goal_is_told(codec, capfd, monkeypatch):
    """On stderr; the file is written, and the metrics say it too."""
    missed = {"goal_met": False}
    monkeypatch.setattr(texture, "compress", lambda source, mips, **options: Exact(source, mips, missed))
    main(["compress", "rock", "-o", "rock.wntc", "--device", "cpu", "--psnr", "79", "--json"])
    said = capfd.readouterr()
    assert json.loads(said.out)["metrics"]["goal_met"] is False and Path("rock.wntc").exists()
    assert "rock.wntc: the goal was not met" in said.err


@pytest.mark.parametrize(
    ("options", "goal"),
    [("--bpp 2", ("bpp", 2.0)), ("--psnr 32.5", ("psnr", 32.5)), ("--quality low", ("quality", "low"))],
)
def test_goals(codec, capfd, options, goal):
    run(capfd, "compress", "rock", "-o", "rock.wntc", *options.split())
    assert {key: codec[0][key] for key in ("bpp", "psnr", "size", "quality")} == {
        **dict.fromkeys(("bpp", "psnr", "size", "quality")),
        **dict([goal]),
    }
    assert codec[0]["mips"] == 1 and codec[0]["weights"] is None


def test_what_decompress_writes_is_the_source(codec, capfd):
    run(capfd, "compress", "rock", "-o", "rock.wntc")
    said = run(capfd, "decompress", "rock.wntc", "-o", "out", "--device", "cpu")
    assert (said["width"], said["height"]) == (9, 6)
    assert said["written"] == ["out/albedo.png", "out/normal.png", "out/ao.png", "out/sky.exr"]
    for name in ("albedo.png", "normal.png", "ao.png", "sky.exr"):
        a, b = load_stored(f"rock/{name}")[0], load_stored(f"out/{name}")[0]
        assert a.shape == b.shape and np.abs(a - b).max() <= (1e-3 if name == "sky.exr" else 0)


def test_levels_rectangles_and_formats(codec, capfd):
    run(capfd, "compress", "rock", "-o", "rock.wntc", "--mips", "3")
    run(capfd, "decompress", "rock.wntc", "-o", "levels", "--mip", "all", "--maps", "albedo,normal")
    assert sorted(map(str, Path("levels").rglob("*.png"))) == [
        f"levels/level_{k}/{name}.png" for k in range(3) for name in ("albedo", "normal")
    ]
    again = load_set("levels")
    assert [level.shape for level in again.levels] == [(6, 9, 6), (3, 4, 6), (1, 2, 6)]
    run(capfd, "compress", "levels", "-o", "levels.wntc")
    assert codec[-1]["mips"] == 3  # those that are given
    run(capfd, "compress", "rock", "-o", "rock.wntc", "--mips", "3")
    said = run(capfd, "decompress", "rock.wntc", "-o", "part", "--mip", "1", "--rectangle", "1,2,3,1", "--exr")
    assert (said["width"], said["height"]) == (3, 1) and all(name.endswith(".exr") for name in said["written"])
    assert load_stored("part/normal.exr")[0].shape == (1, 3, 3)
    said = run(capfd, "decompress", "rock.wntc", "-o", "dds", "--dds", "--bc1", "--maps", "normal,albedo")
    assert said["written"] == ["dds/albedo.dds", "dds/normal.dds"]
    assert len(Path("dds/albedo.dds").read_bytes()) == 148 + 8 * (2 * 3 + 1 + 1)
    said = run(capfd, "decompress", "rock.wntc", "-o", "ktx", "--ktx2", "--bc1", "--maps", "albedo")
    assert said["written"] == ["ktx/albedo.ktx2"]
    assert load_blocks("ktx/albedo.ktx2") == load_blocks("dds/albedo.dds")
    run(capfd, "decompress", "rock.wntc", "-o", "dds", "--dds", "--mip", "2", "--maps", "albedo")
    assert len(Path("dds/albedo.dds").read_bytes()) == 148 + 16


def test_maps_sizes_and_one_picture(codec, capfd):
    said = run(capfd, "compress", "rock", "-o", "a.wntc", "--maps", "albedo", "--resize", "4x2")
    assert [row["map"] for row in said["maps"]] == ["albedo"] and (said["width"], said["height"]) == (4, 2)
    said = run(capfd, "compress", "rock/sky.exr", "-o", "a.wntc", "--resize", "largest")
    assert [row["map"] for row in said["maps"]] == ["sky"]


def test_info(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    shutil.copy(GOLDEN, "named.wntc")
    said = run(capfd, "info", "named.wntc")
    loaded = texture.load(GOLDEN, "cpu")
    spec, sizes = loaded.state.spec, loaded.save("again.wntc")
    assert said["format"] == "wntc" and said["bytes"] == GOLDEN.stat().st_size
    assert (said["height"], said["width"], said["mips"]) == (spec.height, spec.width, spec.mips)
    assert said["grids"] == [vars(grid) for grid in spec.grids] and said["metrics"] == loaded.metrics
    assert [row["map"] for row in said["maps"]] == [each.name for each in loaded.state.maps]
    bits = {name: value * spec.height * spec.width for name, value in said["bits_per_texel_of"].items()}
    assert sum(bits.values()) == pytest.approx(2 * 8 * said["bytes"])  # the parts, and all
    again = TextureFile("again.wntc")
    assert again.sizes == sizes
    Path("named.wntc").rename("unnamed")
    assert run(capfd, "info", "unnamed") == said
    main(["info", "unnamed"])
    assert "map" in capfd.readouterr().out
    Path("none.wntc").write_text("no texture")
    assert "none.wntc: not a neural texture" in refused(capfd, "info", "none.wntc")
    assert "gone.wntc" in refused(capfd, "info", "gone.wntc")


def test_a_stopped_run_is_gone_on_with(codec, capfd, monkeypatch):
    def stopped(source, checkpoint, **options):
        with atomic_path(checkpoint) as temporary:
            temporary.write_text("state")
        raise KeyboardInterrupt

    whole = texture.compress
    monkeypatch.setattr(texture, "compress", stopped)
    with pytest.raises(SystemExit) as exit_info:
        main(["compress", "rock", "-o", "out/rock.wntc"])
    assert exit_info.value.code == 130 and "--resume" in capfd.readouterr().err
    checkpoint = Path("out/checkpoints/rock.wntc.safetensors")
    assert checkpoint.read_text() == "state" and not Path("out/rock.wntc").exists()
    monkeypatch.setattr(texture, "compress", whole)
    assert "there is no" in refused(capfd, "compress", "rock", "-o", "out/other.wntc", "--resume")
    run(capfd, "compress", "rock", "-o", "out/rock.wntc", "--resume")
    assert codec[0]["checkpoint"] == checkpoint and checkpoint.read_text() == "state"
    run(capfd, "compress", "rock", "-o", "out/rock.wntc")
    assert not checkpoint.exists()  # a new run begins anew


@pytest.mark.parametrize(
    ("text", "size"), [("400kB", 400000), ("1 KiB", 1024), ("0.5MB", 500000), ("2MiB", 2**21), ("7", 7), ("9B", 9)]
)
def test_sizes(text, size):
    assert bytes_of("--size", text) == size
