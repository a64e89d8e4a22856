"""Every format there and back, real files, and what bad files say."""

import time

import numpy as np
import OpenEXR
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from warp_neural.errors import InputError
from warp_neural.imaging.image import (
    linear_to_srgb,
    load_exr,
    load_exr_mips,
    load_image,
    save_exr,
    save_exr_mips,
    save_image,
    srgb_to_linear,
)

ALL_CODES = (np.arange(65536, dtype=np.float32) / 65535).reshape(64, 1024)


def picture(height=20, width=30, channels=3):
    rng = np.random.default_rng(0)
    image = rng.random((height, width, channels), dtype=np.float32)
    image[: height // 2] = 0.25  # flat parts make runs
    return image


@given(st.floats(0, 1))
def test_srgb_there_and_back(x):
    assert float(srgb_to_linear(linear_to_srgb(np.float64(x)))) == pytest.approx(x, abs=1e-7)


def test_srgb_known_values():
    assert srgb_to_linear(np.array([0.0, 0.04045, 0.5, 1.0])) == pytest.approx([0, 0.0031308, 0.2140411, 1], abs=1e-6)
    assert linear_to_srgb(np.array([-0.5, 4.0])) == pytest.approx([-6.46, 1.8247963], abs=1e-6)
    assert srgb_to_linear(np.float32([0.2])).dtype == np.float32


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("space", ["linear", "srgb"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_16_bit_is_exact(tmp_path, suffix, space, channels):
    codes = np.stack([np.roll(ALL_CODES, k, axis=1) for k in range(channels)], axis=-1)
    save_image(tmp_path / f"a{suffix}", codes, color_space="linear", bits=16)
    read = load_image(tmp_path / f"a{suffix}", color_space=space)
    save_image(tmp_path / f"b{suffix}", read, color_space=space, bits=16)
    assert np.array_equal(load_image(tmp_path / f"b{suffix}", color_space="linear"), codes)
    assert np.array_equal(read[..., 3:], codes[..., 3:])  # alpha has no colour space


@pytest.mark.parametrize(
    ("suffix", "channels", "bits", "tolerance"),
    [(".png", (1, 3, 4), 8, 0.5 / 255), (".TIFF", (1, 3, 4), 8, 0.5 / 255), (".jpg", (1, 3), 8, 0.1)],
)
def test_8_bit_formats(tmp_path, suffix, channels, bits, tolerance):
    for count in channels:
        encoded = np.linspace(-0.1, 1.1, 64 * 48 * count, dtype=np.float32).reshape(64, 48, count)
        image = np.concatenate([srgb_to_linear(encoded[..., :3]), encoded[..., 3:]], axis=-1)
        save_image(tmp_path / f"a{suffix}", image, bits=bits)
        read = load_image(tmp_path / f"a{suffix}", color_space="linear")
        assert read.shape == image.shape and read.dtype == np.float32
        assert np.abs(read - encoded.clip(0, 1)).max() < tolerance + 1e-6
        assert load_image(tmp_path / f"a{suffix}").max() == 1


def test_float_formats_are_exact(tmp_path):
    for channels in (1, 3):
        image = (picture(channels=channels) - 0.3) * 1000
        for name, bits in (("a.exr", None), ("a.tif", 32)):
            save_image(tmp_path / name, image, bits=bits)
            assert np.array_equal(load_image(tmp_path / name), image)
        save_image(tmp_path / "half.exr", image, bits=16)
        assert np.array_equal(load_image(tmp_path / "half.exr"), image.astype(np.float16))
    save_image(tmp_path / "grey.exr", image[..., 0])
    assert load_image(tmp_path / "grey.exr").shape == (20, 30, 1)
    save_image(tmp_path / "alpha.tif", picture(channels=4), bits=32)
    assert np.array_equal(load_image(tmp_path / "alpha.tif"), picture(channels=4))
    save_image(tmp_path / "encoded.exr", picture(), color_space="srgb")
    assert np.allclose(load_image(tmp_path / "encoded.exr", color_space="srgb"), picture(), atol=1e-6)


def test_exr_is_premultiplied(tmp_path):
    image = picture(channels=4)
    image[3, 4, 3] = 0
    save_image(tmp_path / "a.exr", image)
    stored = load_exr(tmp_path / "a.exr")
    assert np.array_equal(stored["A"], image[..., 3])
    assert np.array_equal(stored["G"], image[..., 1] * image[..., 3])
    read = load_image(tmp_path / "a.exr")
    assert read[3, 4].tolist() == [0, 0, 0, 0]
    image[3, 4] = 0
    assert np.allclose(read, image, rtol=3e-7, atol=0)  # multiplied and divided, each rounded once


@pytest.mark.parametrize("width", [5, 8, 130, 1000])
def test_hdr_within_rgbe_precision(tmp_path, width):
    image = picture(12, width) * np.float32(10.0) ** np.arange(-6, 6, dtype=np.float32)[:, None, None]
    image[0] = 0
    save_image(tmp_path / "a.hdr", image)
    read = load_image(tmp_path / "a.hdr")
    assert np.all(np.abs(read - image) <= image.max(axis=-1, keepdims=True) / 256)
    save_image(tmp_path / "b.hdr", read)
    assert np.array_equal(load_image(tmp_path / "b.hdr"), read)  # what RGBE can hold, it holds exactly
    save_image(tmp_path / "grey.hdr", image[..., 0])
    assert load_image(tmp_path / "grey.hdr").shape == image.shape


def test_other_kinds_of_png_and_tiff(tmp_path):
    rgb = (picture(8, 8) * 255).astype(np.uint8)
    Image.fromarray(rgb).quantize(256).save(tmp_path / "palette.png")
    Image.fromarray(rgb[..., 0] > 128).save(tmp_path / "bits.png")
    Image.fromarray(rgb[..., :2].copy(), "LA").save(tmp_path / "grey_alpha.png")
    Image.fromarray(rgb).save(tmp_path / "lzw.tif", compression="tiff_lzw")
    tifffile.imwrite(tmp_path / "planar.tif", np.moveaxis(rgb, -1, 0), photometric="rgb", planarconfig="separate")
    assert np.array_equal(load_image(tmp_path / "palette.png", color_space="linear"), rgb / np.float32(255))
    assert set(np.unique(load_image(tmp_path / "bits.png"))) <= {0, 1}
    assert np.array_equal(load_image(tmp_path / "grey_alpha.png")[..., 3], rgb[..., 1] / np.float32(255))
    for name in ("lzw.tif", "planar.tif"):
        assert np.array_equal(load_image(tmp_path / name, color_space="linear"), rgb / np.float32(255))


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif", "a.hdr", "a.exr"])
def test_the_same_picture_is_the_same_file(tmp_path, name):
    def saved():
        save_image(tmp_path / name, picture())
        save_exr_mips(tmp_path / "mips.exr", [picture(2, 2), picture(1, 1)])
        return [(tmp_path / file).read_bytes() for file in (name, "mips.exr")]

    before = saved()
    time.sleep(1.1)  # the time in a file has seconds
    assert saved() == before


def test_png_is_read_by_pillow_as_it_was_written(tmp_path):
    save_image(tmp_path / "a.png", picture(), color_space="linear", bits=16)
    with Image.open(tmp_path / "a.png") as other:
        assert np.abs(np.asarray(other) / 255 - picture()).max() < 1.01 / 255


@pytest.mark.parametrize("compression", ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"])
def test_exr_channels_and_compressions(tmp_path, compression):
    depth = np.linspace(0, 9, 600, dtype=np.float32).reshape(20, 30)
    channels = {
        "left.Z": depth,
        "mask": depth.astype(np.float16),
        "id": np.arange(600, dtype=np.uint32).reshape(20, 30),
    }
    save_exr(tmp_path / "a.exr", channels, compression=getattr(OpenEXR, f"{compression}_COMPRESSION"))
    read = load_exr(tmp_path / "a.exr")
    assert {name: values.dtype for name, values in read.items()} == {n: v.dtype for n, v in channels.items()}
    assert np.array_equal(read["id"], channels["id"])
    assert np.abs(read["mask"] - channels["mask"]).max() < 0.05
    with pytest.raises(InputError, match=r"left\.Z.*load_exr"):
        load_image(tmp_path / "a.exr")


@pytest.mark.parametrize("size", [(1, 1), (64, 64), (100, 37), (3, 300)])
def test_exr_mips(tmp_path, size):
    names = ["R", "G", "B", "roughness"]
    count = max(size).bit_length()
    levels = [picture(max(1, size[0] >> k), max(1, size[1] >> k), 4).astype(np.float16) for k in range(count)]
    save_exr_mips(tmp_path / "a.exr", levels, names)
    read = load_exr_mips(tmp_path / "a.exr")
    for level, channels in zip(levels, read, strict=True):
        assert all(np.array_equal(channels[name], level[..., k]) for k, name in enumerate(names))
    tiles = OpenEXR.File(str(tmp_path / "a.exr"), header_only=True).header()["tiles"]
    assert tiles.mode == OpenEXR.MIPMAP_LEVELS
    assert np.array_equal(load_exr(tmp_path / "a.exr")["R"], levels[0][..., 0])  # any reader sees the finest level


def test_exr_mips_bad_use(tmp_path):
    path = tmp_path / "a.exr"
    levels = [np.zeros((4 >> k, 4 >> k, 3), np.float32) for k in range(3)]
    for wrong in ([], levels[:2], [*levels[:2], levels[1]], [np.zeros((0, 4, 3), np.float32)]):
        with pytest.raises(InputError, match="mip levels"):
            save_exr_mips(path, wrong)
    with pytest.raises(InputError, match="R, G"):
        save_exr_mips(path, levels, ["R", "G"])
    with pytest.raises(InputError, match="float64"):
        save_exr_mips(path, [level.astype(float) for level in levels])
    save_image(path, levels[0])
    with pytest.raises(InputError, match="load_exr"):
        load_exr_mips(path)
    save_exr_mips(path, levels)
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(InputError, match=r"cannot be read.*past end"):
        load_exr_mips(path)
