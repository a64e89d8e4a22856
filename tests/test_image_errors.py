"""What bad image files and wrong use say; real files."""

import struct
import zlib

import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image

from warp_neural.errors import InputError
from warp_neural.imaging.image import load_exr, load_image, save_exr, save_image

PICTURE = np.random.default_rng(0).random((64, 48, 3), dtype=np.float32)


def refused(path, words, action=load_image):
    """`action(path)` is refused in one line that names the file and holds `words`."""
    with pytest.raises(InputError, match=words) as caught:
        action(path)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif", "a.hdr", "a.exr"])
@pytest.mark.parametrize("kept", [0.5, 0.1])
def test_truncated(tmp_path, name, kept):
    path = tmp_path / name
    save_image(path, PICTURE)
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * kept)])
    refused(path, "export or copy it again")


def test_truncated_flat_hdr(tmp_path):
    save_image(tmp_path / "a.hdr", PICTURE[:, :5])
    (tmp_path / "a.hdr").write_bytes((tmp_path / "a.hdr").read_bytes()[:-3])
    refused(tmp_path / "a.hdr", "cut short")


def test_hdr_of_other_kinds(tmp_path):
    path = tmp_path / "a.hdr"
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n\1\2\3\4")
    refused(path, "XYZE.*ra_xyze")
    path.write_bytes(b"#?RADIANCE\nFORMAT=16-bit\n\n-Y 1 +X 1\n\1\2\3\4")
    refused(path, "FORMAT=16-bit")
    path.write_bytes(b"#?RADIANCE\n\n-Y 1 +X 2\n\1\1\1\1\1\2\3\4")  # repeats a pixel before the first
    refused(path, "damaged")
    path.write_bytes(b"#?RGBE\n\n-Y 1 +X 8\n\2\2\0\x08" + 4 * b"\x89\x01")  # runs of 9 in rows of 8
    refused(path, "damaged")
    for header in (b"EXPOSURE=0", b"EXPOSURE=one", b"PRIMARIES=1 2", b"COLORCORR=1 1"):
        path.write_bytes(b"#?RGBE\n" + header + b"\n\n-Y 1 +X 8\n\2\2\0\x08" + 4 * b"\x88\x80")
        refused(path, header.split(b"=")[0].decode())


def hostile_png(size):
    body = struct.pack(">IIBBBBB", size, size, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + b"IHDR" + body + struct.pack(">I", zlib.crc32(b"IHDR" + body))


def with_bytes(path, marker, offset, values):
    """Overwrite the bytes `offset` after `marker`."""
    data = bytearray(path.read_bytes())
    at = data.index(marker) + len(marker) + offset
    data[at : at + len(values)] = values
    path.write_bytes(data)


@pytest.mark.parametrize("size", [12_000, 60_000, 2**31 - 1])
def test_gigantic_sizes_are_refused_from_the_header(tmp_path, size):
    (tmp_path / "a.png").write_bytes(hostile_png(size))
    refused(tmp_path / "a.png", "scale it down|claims|damaged")
    (tmp_path / "a.hdr").write_bytes(b"#?RGBE\n\n-Y %d +X %d\n" % (size, size))
    refused(tmp_path / "a.hdr", "claims|size")
    save_image(tmp_path / "a.exr", PICTURE)
    with_bytes(tmp_path / "a.exr", b"dataWindow\0box2i\0", 4, struct.pack("<4i", 0, 0, size - 1, size - 1))
    refused(tmp_path / "a.exr", "claims|exceeds|Invalid")
    tifffile.imwrite(tmp_path / "a.tif", PICTURE, photometric="rgb")
    with_bytes(tmp_path / "a.tif", struct.pack("<HHI", 256, 4, 1), 0, struct.pack("<I", size))
    with_bytes(tmp_path / "a.tif", struct.pack("<HHI", 257, 4, 1), 0, struct.pack("<I", size))
    refused(tmp_path / "a.tif", "claims")


def test_gigantic_exr_tiles(tmp_path):
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 32
    header = {"type": OpenEXR.tiledimage, "tiles": tiles, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, {"Y": PICTURE[..., 0].copy()}).write(str(tmp_path / "a.exr"))
    assert np.array_equal(load_image(tmp_path / "a.exr"), PICTURE[..., :1])
    with_bytes(tmp_path / "a.exr", b"tiles\0tiledesc\0", 4, struct.pack("<2I", 64, 2**24))
    refused(tmp_path / "a.exr", "tiles of|tile size")


def test_names_and_suffixes(tmp_path):
    refused(tmp_path / "none.png", "cannot be read")
    refused(tmp_path / "a.webp", "unknown suffix.*\\.png")
    save_image(tmp_path / "a.jpg", PICTURE)
    (tmp_path / "a.jpg").rename(tmp_path / "a.png")
    refused(tmp_path / "a.png", "content is JPEG, not PNG; rename")
    (tmp_path / "b.exr").write_bytes(b"")
    refused(tmp_path / "b.exr", "no known image, not EXR")
    (tmp_path / "folder.png").mkdir()
    refused(tmp_path / "folder.png", "cannot be read")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite(tmp_path, value):
    bad = PICTURE.copy()
    bad[3, 4, 1] = value
    for name in ("a.png", "a.hdr", "a.exr"):
        refused(tmp_path / name, "NaN", lambda path: save_image(path, bad))
        assert not list(tmp_path.iterdir())
    save_exr(tmp_path / "a.exr", {name: bad[..., k] for k, name in enumerate("RGB")})
    refused(tmp_path / "a.exr", "NaN")
    tifffile.imwrite(tmp_path / "a.tif", bad, photometric="rgb")
    refused(tmp_path / "a.tif", "NaN")


def test_exr_of_many_parts_and_deep(tmp_path):
    header = {"type": OpenEXR.scanlineimage}
    parts = [OpenEXR.Part(dict(header), {"Z": PICTURE[..., 0].copy()}, name) for name in ("left", "right")]
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    refused(tmp_path / "a.exr", "multi-part.*left, right", load_exr)
    samples = np.empty((2, 2), dtype=object)
    for index in np.ndindex(2, 2):
        samples[index] = np.ones(3, np.float32)
    deep = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    OpenEXR.File(deep, {"Z": samples}).write(str(tmp_path / "deep.exr"))
    refused(tmp_path / "deep.exr", "deep", load_exr)


def test_wrong_use(tmp_path):
    for shape in ((4, 4, 2), (4, 4, 5), (4,), (0, 4, 3)):
        refused(tmp_path / "a.png", "shape", lambda path, shape=shape: save_image(path, np.zeros(shape, np.float32)))
    refused(tmp_path / "a.jpg", "JPEG takes", lambda path: save_image(path, np.zeros((4, 4, 4), np.float32)))
    refused(tmp_path / "a.jpg", "65500 a side", lambda path: save_image(path, np.zeros((65501, 1), np.float32)))
    refused(tmp_path / "a.png", "uint8", lambda path: save_image(path, np.zeros((4, 4), np.uint8)))
    refused(tmp_path / "a.png", "bits=12", lambda path: save_image(path, PICTURE, bits=12))
    refused(tmp_path / "a.png", "sRGB", lambda path: save_image(path, PICTURE, color_space="sRGB"))
    refused(tmp_path / "a.exr", "bits=32", lambda path: save_image(path, PICTURE * 1e6, bits=16))
    refused(tmp_path / "a.hdr", "0 to", lambda path: save_image(path, -PICTURE))
    refused(tmp_path / "a.exr", "one size", lambda path: save_exr(path, {"A": PICTURE[..., 0], "B": PICTURE[1:, :, 0]}))
    refused(tmp_path / "a.exr", "no channel", lambda path: save_exr(path, {}))
    assert not list(tmp_path.iterdir())


def test_types_of_tiff_that_are_not_taken(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((4, 4), np.int32))
    refused(tmp_path / "a.tif", "32-bit signed integers")
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((4, 4, 6), np.uint8), photometric="minisblack", planarconfig="contig")
    refused(tmp_path / "a.tif", "6 channels")


def test_small_file_of_a_large_picture(tmp_path):
    Image.new("1", (20_000, 10_000)).save(tmp_path / "a.png")  # 200 million pixels in a small file
    refused(tmp_path / "a.png", "claims.*scale it down")


def test_real_files(shared_data):
    exact = load_image(shared_data / "hdr" / "venice_sunset_1k.hdr")
    half = load_image(shared_data / "hdr" / "venice_sunset_1k_half.exr")
    assert exact.shape == (512, 1024, 3) and exact.min() == 0
    assert np.array_equal(exact.astype(np.float16), half)
    lossy = load_image(shared_data / "hdr" / "workshop_dwab.exr")
    assert lossy.shape == (256, 512, 3) and lossy.min() == pytest.approx(-63.47, abs=0.01)
    assert load_image(shared_data / "course" / "slangstars.png").shape == (256, 256, 3)
