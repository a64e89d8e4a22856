"""TIFF of every depth, compression, byte order, layout and meaning: the same numbers, or refused by name."""

import numpy as np
import pytest
import tifffile
from image_files import (
    BLACK_IS_ZERO,
    DEFLATE,
    LZW,
    NONE,
    PACKBITS,
    PALETTE,
    PREMULTIPLIED,
    RGB,
    STRAIGHT,
    WHITE_IS_ZERO,
    png,
    tiff,
)
from image_picture import COLOUR, EXACT, GREY, PICTURE, RNG, UPRIGHT, codes_of, loads, refused, with_alpha
from PIL import Image

from warp_neural.imaging.image import load_image, srgb_to_linear

tiff_depths = pytest.mark.parametrize("bits", [1, 2, 4, 6, 8, 10, 12, 14, 16, 32])
compressions = pytest.mark.parametrize(
    ("order", "compression"), [("<", NONE), (">", NONE), ("<", LZW), (">", LZW), ("<", DEFLATE), (">", PACKBITS)]
)
orders = pytest.mark.parametrize("order", ["<", ">"])


@compressions
@tiff_depths
def test_tiff_integers(tmp_path, bits, compression, order):
    kind, top = {"order": order, "compression": compression}, 2**bits - 1
    codes = codes_of(PICTURE, bits)
    values = codes / top
    loads(tmp_path / "a.tif", tiff(codes[..., :1], bits, BLACK_IS_ZERO, **kind), values[..., :1])
    loads(tmp_path / "b.tif", tiff(codes[..., :1], bits, WHITE_IS_ZERO, **kind), 1 - values[..., :1])
    if bits > 1:
        loads(tmp_path / "c.tif", tiff(codes[..., :3], bits, RGB, **kind), values[..., :3])
        loads(tmp_path / "d.tif", tiff(codes[..., :3], bits, RGB, tile=16, **kind), values[..., :3])
    planar = tiff(codes[..., :3], bits, RGB, planar=True, **kind)
    if bits in (8, 16, 32):
        loads(tmp_path / "e.tif", planar, values[..., :3])
    else:
        refused(tmp_path / "e.tif", planar, f"separate planes of {bits} bits")
    if bits in (8, 16, 32) and compression in (LZW, DEFLATE):
        data = tiff(codes[..., :3], bits, RGB, predictor=2, **kind)
        loads(tmp_path / "f.tif", data, values[..., :3])


@compressions
@pytest.mark.parametrize("bits", [2, 4, 8, 12, 16, 32])
def test_tiff_alpha(tmp_path, bits, compression, order):
    kind, top = {"order": order, "compression": compression}, 2**bits - 1
    codes = codes_of(PICTURE, bits)
    for name, extra in (("a", STRAIGHT), ("b", None)):  # without a word about it, alpha is taken as straight
        loads(tmp_path / f"{name}.tif", tiff(codes, bits, RGB, extra=extra, **kind), codes / top)
    codes = codes_of(with_alpha(COLOUR * PICTURE[..., 3:], PICTURE[..., 3:]), bits)
    values = codes / top
    alpha = values[..., 3:]
    divided = np.minimum(values[..., :3] / np.where(alpha == 0, 1, alpha), 1)
    loads(tmp_path / "c.tif", tiff(codes, bits, RGB, extra=PREMULTIPLIED, **kind), with_alpha(divided, alpha))
    grey = tiff(codes[..., [0, 3]], bits, BLACK_IS_ZERO, extra=PREMULTIPLIED, **kind)
    loads(tmp_path / "d.tif", grey, with_alpha(divided[..., :1], alpha))
    grey = tiff(codes[..., [0, 3]], bits, WHITE_IS_ZERO, extra=STRAIGHT, **kind)
    loads(tmp_path / "e.tif", grey, with_alpha(1 - values[..., :1], alpha))


@pytest.mark.parametrize("bits", [4, 8, 12, 16, 32])
def test_colours_are_decoded_from_srgb_and_alpha_is_not(tmp_path, bits):
    codes = codes_of(PICTURE, bits)
    files = {"a.tif": tiff(codes, bits, RGB), "b.tif": tiff(codes, bits, RGB, extra=PREMULTIPLIED)}
    files |= {"c.png": png(codes, bits, 6)} if bits in (8, 16) else {}
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
        encoded = load_image(tmp_path / name, color_space="linear")
        expected = np.concatenate([srgb_to_linear(encoded[..., :3]), encoded[..., 3:]], axis=-1)
        assert np.abs(load_image(tmp_path / name) - expected).max() < 3e-7  # sRGB's slope is at most 2.3


@compressions
@pytest.mark.parametrize("bits", [1, 2, 4, 8])
def test_tiff_palettes_have_16_bits(tmp_path, bits, compression, order):
    colours = RNG.integers(0, 65536, (2**bits, 3))
    codes = codes_of(GREY, bits)
    data = tiff(codes, bits, PALETTE, order=order, compression=compression, color_map=colours.T.reshape(-1).tolist())
    loads(tmp_path / "a.tif", data, colours[codes[..., 0].astype(int)] / 65535)


@orders
@pytest.mark.parametrize("bits", [16, 32])
@pytest.mark.parametrize("predictor", [1, 3])
def test_tiff_floats(tmp_path, bits, predictor, order):
    values = (COLOUR * 4 - 1).astype(f"f{bits // 8}")
    for compression in (LZW, DEFLATE):
        for extra in ({}, {"tile": 16}, {"planar": True}):
            kind = {"order": order, "compression": compression, "predictor": predictor, **extra}
            (tmp_path / "a.tif").write_bytes(tiff(values, bits, RGB, sample_format=3, **kind))
            assert np.array_equal(load_image(tmp_path / "a.tif"), values.astype(np.float32))
    premultiplied = with_alpha(COLOUR * PICTURE[..., 3:], PICTURE[..., 3:]).astype(f"f{bits // 8}")
    (tmp_path / "b.tif").write_bytes(tiff(premultiplied, bits, RGB, sample_format=3, extra=PREMULTIPLIED, order=order))
    assert np.allclose(load_image(tmp_path / "b.tif"), PICTURE, atol=2e-3 if bits == 16 else 1e-6)


@orders
@pytest.mark.parametrize("orientation", UPRIGHT)
def test_tiff_orientation(tmp_path, orientation, order):
    codes = codes_of(COLOUR, 16)
    data = tiff(codes, 16, RGB, order=order, orientation=orientation)
    loads(tmp_path / "a.tif", data, UPRIGHT[orientation](codes / 65535))


def test_large_tiffs_in_many_strips(tmp_path):
    codes = RNG.integers(0, 65536, (301, 257, 3)).astype(np.uint64)  # large ones are read in threads
    for kind in ({}, {"predictor": 2}, {"tile": 64, "predictor": 2}, {"planar": True}):
        for order in "<>":
            loads(tmp_path / "a.tif", tiff(codes, 16, RGB, compression=DEFLATE, order=order, **kind), codes / 65535)


def test_other_writers(tmp_path):
    codes = codes_of(COLOUR, 16).astype(np.uint16)
    tifffile.imwrite(tmp_path / "big.tif", codes, bigtiff=True, photometric="rgb")
    assert np.abs(load_image(tmp_path / "big.tif", color_space="linear") - codes / 65535).max() < EXACT
    black = GREY[..., 0] > 0.5
    for compression in (None, "group3", "group4", "packbits"):
        Image.fromarray(black).save(tmp_path / "fax.tif", compression=compression)
        assert np.array_equal(load_image(tmp_path / "fax.tif")[..., 0], black)
    smooth = (np.linspace(0, 255, 4096).reshape(64, 64, 1) * [1, 0.5, 0.25]).astype(np.uint8)
    for name, picture in (("colour", smooth), ("grey", smooth[..., 0])):
        Image.fromarray(picture).save(tmp_path / f"{name}.tif", compression="jpeg", quality=98)
        read = load_image(tmp_path / f"{name}.tif", color_space="linear").squeeze()
        assert np.abs(read - picture / 255).max() < 0.03
    codes = codes_of(GREY, 8)
    reversed_bits = np.packbits(np.unpackbits(codes.astype(np.uint8)[..., None], axis=-1)[..., ::-1], axis=-1)[..., 0]
    reverse = {"more": [(266, 3, [2])]}
    loads(tmp_path / "order.tif", tiff(reversed_bits, 8, BLACK_IS_ZERO, **reverse), codes / 255)
    refused(tmp_path / "zip.tif", tiff(codes, 8, BLACK_IS_ZERO, compression=DEFLATE, **reverse), "bits in reverse")


@pytest.mark.parametrize(
    ("words", "options"),
    [
        ("24-bit integers", {"bits": 24}),
        ("8-bit signed integers", {"more": [(339, 3, [2])]}),
        ("64-bit floats", {"bits": 64, "sample_format": 3}),
        ("CIELAB", {"photometric": 8}),
        ("LOGLUV", {"photometric": 32845}),
        ("predictor 2", {"predictor": 2}),
        ("palette TIFF with further channels", {"photometric": PALETTE, "color_map": range(768)}),
    ],
)
def test_tiff_that_is_refused_by_name(tmp_path, words, options):
    options = {"bits": 8, "photometric": RGB, **options}
    values = COLOUR if "sample_format" in options else codes_of(COLOUR, options["bits"])
    refused(tmp_path / "a.tif", tiff(values, **options), words)
