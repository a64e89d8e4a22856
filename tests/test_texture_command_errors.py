"""`warp-neural compress` and `decompress`: one line for bad input, and nothing written."""

from pathlib import Path

import numpy as np
import pytest
from command_line import refused, run
from texture_codec import codec

from warp_neural.imaging.image import save_image

__all__ = ["codec"]  # a fixture

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
    ("--losses normal=cosine", "give maps and one of l2, angle, luminance"),
    ("--weights normal", "give maps and numbers"),
    ("--weights normal=-1", "give maps and numbers"),
    ("--weights normal=inf", "give maps and numbers"),
    ("--weights color=1", "no map 'color'; there are albedo, normal, ao, sky"),
    ("--resize 4", "--resize 4: give width and height"),
    ("--resize 0x9", "--resize 0x9: give sides of 1 to 16384"),
    ("--device cuda:99", "--device cuda:99: no such device"),
    ("--for engine", "rock.wntc: name it .safetensors with --for engine"),
    ("--ktx2", "--ktx2: is for latents of --for engine"),
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
    ("rock.wntc --dds --exr", "--exr: give one"),
    ("rock.wntc --dds --ktx2", "--exr: give one"),
    ("rock.wntc --bc1", "--bc1 only with --dds"),
    ("rock.wntc --dds --best", "--best with --bc1"),
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
