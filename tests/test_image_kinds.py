"""PNG and JPEG of every depth, palette, transparency and orientation: the same picture is the same numbers."""

import struct

import numpy as np
import pytest
from image_files import CMYK, png, tiff
from image_picture import GREY, HEIGHT, PICTURE, RNG, UPRIGHT, WIDTH, codes_of, loads, refused, with_alpha
from PIL import Image

from warp_neural.imaging.image import load_image


@pytest.mark.parametrize("interlaced", [False, True])
@pytest.mark.parametrize("bits", [1, 2, 4, 8, 16])
def test_png_grey(tmp_path, bits, interlaced):
    codes = codes_of(GREY, bits)
    values, clear = codes / (2**bits - 1), codes[3, 3]
    loads(tmp_path / "a.png", png(codes, bits, 0, interlaced=interlaced), values)
    transparent = struct.pack(">H", int(clear[0]))
    data = png(codes, bits, 0, transparent=transparent, interlaced=interlaced)
    loads(tmp_path / "b.png", data, with_alpha(values, codes != clear))


@pytest.mark.parametrize("bits", [1, 2, 4, 8])
def test_png_palettes(tmp_path, bits):
    codes, palette = codes_of(GREY, bits), RNG.integers(0, 256, (2**bits, 3))
    colours = palette[codes[..., 0].astype(int)] / 255
    loads(tmp_path / "a.png", png(codes, bits, 3, palette=palette), colours)
    alpha = np.full(2**bits, 255)
    alpha[: 2 ** (bits - 1)] = RNG.integers(0, 255, 2 ** (bits - 1))
    data = png(codes, bits, 3, palette=palette, transparent=alpha[: 2 ** (bits - 1)].astype(np.uint8).tobytes())
    loads(tmp_path / "b.png", data, with_alpha(colours, alpha[codes.astype(int)] / 255))


@pytest.mark.parametrize("bits", [8, 16])
def test_png_colours(tmp_path, bits):
    codes, top = codes_of(PICTURE, bits), 2**bits - 1
    clear = codes[3, 3, :3]
    loads(tmp_path / "a.png", png(codes[..., :3], bits, 2), codes[..., :3] / top)
    loads(tmp_path / "b.png", png(codes, bits, 6, interlaced=True), codes / top)
    loads(tmp_path / "c.png", png(codes[..., [0, 3]], bits, 4), with_alpha(codes[..., :1] / top, codes[..., 3:] / top))
    opaque = (codes[..., :3] != clear).any(axis=-1, keepdims=True)
    data = png(codes[..., :3], bits, 2, transparent=struct.pack(">3H", *clear.tolist()))
    loads(tmp_path / "d.png", data, with_alpha(codes[..., :3] / top, opaque))


@pytest.mark.parametrize("orientation", UPRIGHT)
@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_exif_orientation(tmp_path, orientation, suffix):
    smooth = np.linspace(0, 255, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH, 1) * [1.0, 0.5, 0.25]
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(smooth.astype(np.uint8)).save(tmp_path / f"a{suffix}", exif=exif, quality=98, subsampling=0)
    read = load_image(tmp_path / f"a{suffix}", color_space="linear")
    assert np.abs(read - UPRIGHT[orientation](smooth) / 255).max() < (0.02 if suffix == ".jpg" else 0.004)


def test_inks(tmp_path):
    codes = codes_of(PICTURE, 8)
    values = codes / 255
    data = tiff(codes, 8, CMYK)
    loads(tmp_path / "a.tif", data, (1 - values[..., :3]) * (1 - values[..., 3:]), tolerance=0.5 / 255)
    smooth = Image.fromarray(
        (np.linspace(0, 255, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH, 1) * [1, 0.5, 0.25]).astype("u1")
    )
    smooth.convert("CMYK").save(tmp_path / "b.jpg", quality=98)
    assert np.abs(load_image(tmp_path / "b.jpg", color_space="linear") - np.asarray(smooth) / 255).max() < 0.03
    profile = struct.pack(">I", 132) + b"\0" * 12 + b"CMYK" + b"\0" * 16 + b"acsp" + b"\0" * 88 + b"\0" * 4
    smooth.convert("CMYK").save(tmp_path / "c.jpg", icc_profile=profile)
    refused(tmp_path / "c.jpg", (tmp_path / "c.jpg").read_bytes(), "CMYK with a colour profile.*sRGB")
    refused(tmp_path / "d.tif", tiff(codes, 8, CMYK, more=[(34675, 7, list(profile))]), "CMYK with a colour profile")
