"""`warp-neural compress`, `decompress` and `info` of textures: options, files, one line for bad input.

The codec stands aside: what is asked of it is kept, and a texture that holds its source exactly comes back.
"""

import json
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from warp_neural import texture
from warp_neural.cli.commands import main
from warp_neural.cli.quantities import bytes_of
from warp_neural.errors import InputError
from warp_neural.imaging.image import load_stored, save_image
from warp_neural.io.files import atomic_path
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.texture.file import TextureFile
from warp_neural.texture.kinds import to_maps
from warp_neural.texture.maps import TextureSet, load_set, mip_chain
from warp_neural.texture.state import Tensor, TextureState

GOLDEN = Path(__file__).parent / "golden" / "version_1.wntc"
RNG = np.random.default_rng(11)


@dataclass
class Exact:
    """A texture without losses, in place of a codec's."""

    source: TextureSet
    mips: int
    metrics: dict = field(default_factory=lambda: {"psnr": 99.0})

    @property
    def state(self):
        height, width = self.source.size
        spec = TextureSpec(height, width, self.source.channels, self.mips, (Grid(4, 2),), (8,))
        latents = tuple((np.zeros((*spec.cells(mip, 0), 2), np.int8),) for mip in range(self.mips))
        tensors = {name: Tensor(np.zeros(shape, np.int32), 0.5) for name, shape in spec.tensors.items()}
        return TextureState(spec, latents, tensors, self.source.maps)

    def save(self, path):
        with atomic_path(path) as temporary:
            temporary.write_bytes(bytes(100))
        return {"latents": [[50], [10]][: self.mips], "network": 40, "all": 100}

    def decode(self, mip=0, rectangle=None):
        values = mip_chain(self.source)[mip]
        if rectangle:
            x, y, w, h = rectangle
            values = values[y : y + h, x : x + w]
        return to_maps(values, self.source.maps)


@pytest.fixture
def codec(tmp_path, monkeypatch):
    """A working folder with a material, and the calls of the codec that are kept."""
    monkeypatch.chdir(tmp_path)
    albedo, normal = RNG.integers(0, 256, (2, 6, 9, 3)) / 255
    save_image("rock/albedo.png", albedo, color_space="linear")
    save_image("rock/normal.png", normal, color_space="linear")
    save_image("rock/sky.exr", 50 * RNG.random((6, 9, 3)))
    save_image("rock/ao.png", np.ones((6, 9)), color_space="linear")
    calls, made = [], {}

    def compress(source, **options):
        calls.append(options)
        made["texture"] = Exact(source, options["mips"])
        return made["texture"]

    def load(path, device=None):
        if not Path(path).is_file():
            raise InputError(f"{path}: no such file; give a neural texture")
        return made["texture"]

    monkeypatch.setattr(texture, "compress", compress, raising=False)
    monkeypatch.setattr(texture, "load", load, raising=False)
    return calls


def run(capfd, *args):
    capfd.readouterr()
    main([*args, "--json"])
    (line,) = capfd.readouterr().out.splitlines()
    return json.loads(line, parse_constant=pytest.fail)


def refused(capfd, *args):
    capfd.readouterr()
    with pytest.raises(SystemExit) as exit_info:
        main(list(args))
    assert exit_info.value.code == 2
    captured = capfd.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1
    return captured.err


def test_options_reach_the_codec(codec, capfd):
    options = ["--size", "1.5KiB", "--weights", "albedo=2, normal=0.5", "--losses", "normal=angle"]
    options += ["--mips", "all", "--seed", "7", "--preview"]
    said = run(capfd, "compress", "rock", "-o", "out/rock.wntc", "--device", "cpu", *options)
    (call,) = codec
    assert call.pop("device").alias == "cpu" and call.pop("quiet")
    assert call == {
        "bpp": None,
        "psnr": None,
        "size": 1536,
        "quality": None,
        "preview": True,
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


BAD_COMPRESS = [
    ("--bpp 0", "--bpp 0.0: give a number above 0, at most 64"),
    ("--bpp nan", "--bpp nan"),
    ("--psnr 5", "--psnr 5.0: give 10 to 80"),
    ("--bpp 2 --size 1kB", "--bpp and --size: each chooses"),
    ("--size 0kB", "--size 0kB: give a size such as 400kB"),
    ("--size 1kX", "--size 1kX: give a size"),
    ("--size -1", "--size -1: give a size"),
    ("--mips 5", "--mips 5: 9 x 6 texels have 1 to 4 levels"),
    ("--mips 0", "--mips 0: 9 x 6"),
    ("--mips most", "--mips most: 9 x 6"),
    ("--maps colour", "--maps colour: rock holds albedo, normal, ao, sky"),
    ("--maps ,", "no maps"),
    ("--losses normal=cosine", "give maps and one of l2, angle, perceptual"),
    ("--weights normal", "give maps and numbers"),
    ("--weights normal=-1", "give maps and numbers"),
    ("--weights normal=inf", "give maps and numbers"),
    ("--weights color=1", "no map 'color'; there are albedo, normal, ao, sky"),
    ("--resize 4", "--resize 4: give width and height"),
    ("--resize 0x9", "--resize 0x9: give sides of 1 to 16384"),
    ("--device cuda:99", "--device cuda:99: no such device"),
    ("--resume", "--resume: . has no checkpoints"),
]


@pytest.mark.parametrize(("options", "message"), BAD_COMPRESS, ids=lambda value: str(value)[:24])
def test_bad_options_of_compress(codec, capfd, options, message):
    before = sorted(Path().rglob("*"))
    assert message in refused(capfd, "compress", "rock", "-o", "rock.wntc", *options.split())
    assert not codec and sorted(Path().rglob("*")) == before


BAD_DECOMPRESS = [
    ("none.wntc", "none.wntc: no such file"),
    ("rock.wntc --mip 2", "--mip 2: give 0 to 1, or all"),
    ("rock.wntc --mip -1", "--mip -1: give 0 to 1"),
    ("rock.wntc --mip all --rectangle 0,0,1,1", "--rectangle: lies in one mip level"),
    ("rock.wntc --rectangle 0,0,9", "--rectangle 0,0,9: give left, top, width and height"),
    ("rock.wntc --rectangle 0,0,10,1", "does not lie in the 9 x 6 texels"),
    ("rock.wntc --mip 1 --rectangle 0,0,5,1", "does not lie in the 4 x 3 texels"),
    ("rock.wntc --rectangle 0,0,0,1", "does not lie in"),
    ("rock.wntc --maps colour", "--maps colour: rock.wntc holds albedo, normal, ao, sky"),
    ("rock.wntc --maps ,", "--maps: give some of albedo"),
    ("rock.wntc --dds --exr", "--dds or --exr"),
    ("rock.wntc --bc1", "--bc1 only with --dds"),
]


@pytest.mark.parametrize(("options", "message"), BAD_DECOMPRESS, ids=lambda value: str(value)[:24])
def test_bad_options_of_decompress(codec, capfd, options, message):
    run(capfd, "compress", "rock", "-o", "rock.wntc", "--mips", "2")
    assert message in refused(capfd, "decompress", "-o", "out", *options.split())
    assert not Path("out").exists()


def test_bad_places(codec, capfd):
    assert "rock: a folder or device" in refused(capfd, "compress", "rock", "-o", "rock")
    assert "cannot write here" in refused(capfd, "compress", "rock", "-o", "rock/ao.png/a.wntc")
    assert "none: not a readable folder" in refused(capfd, "compress", "none", "-o", "a.wntc")
    save_image("rock/height.png", np.ones((3, 3)), color_space="linear")
    line = refused(capfd, "compress", "rock", "-o", "a.wntc")
    assert "unequal sizes" in line and "height.png 3 x 3" in line and "--resize 9x6" in line
    assert not codec and not Path("a.wntc").exists()


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
