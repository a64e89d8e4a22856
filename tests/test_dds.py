"""DDS files as other programs read them: headers, blocks of every level, formats by DXGI's numbers."""

import struct

import numpy as np
import pytest
import texture2ddecoder
from PIL import Image
from skimage import data

from warp_neural.errors import InputError
from warp_neural.imaging.block_encoders import encode_blocks
from warp_neural.imaging.dds import save_dds

BYTES = {"bc1": 8, "bc3": 16, "bc4": 8, "bc5": 16, "bc7": 16}
PICTURE = data.astronaut()[96:196, 150:251].astype(np.float32) / 255  # [100, 101, 3], a face
ALPHA = np.linspace(0, 1, 101, dtype=np.float32)[None, :, None].repeat(100, axis=0)


def psnr(a, b):
    return -10 * np.log10(np.square(a - b, dtype=np.float64).mean())


def chain(picture, count):
    """Any levels of the right sizes."""
    return [picture[:: 2**k, :: 2**k][: max(100 >> k, 1), : max(101 >> k, 1)] for k in range(count)]


def read(path, format):
    """(DXGI's number, levels [height, width, 4] in [0, 1]) of a DDS of blocks."""
    file = path.read_bytes()
    magic, size, _flags, height, width, linear, _depth, count = struct.unpack_from("<4s7I", file)
    pixel_size, kind, name = struct.unpack_from("<2I4s", file, 76)
    dxgi, dimensions, _misc, array, alpha = struct.unpack_from("<5I", file, 128)
    assert (magic, size, pixel_size, kind, name, dimensions, array) == (b"DDS ", 124, 32, 4, b"DX10", 3, 1)
    assert alpha in (1, 3)
    at, levels = 148, []
    for k in range(count):
        h, w = max(height >> k, 1), max(width >> k, 1)
        length = -(-h // 4) * -(-w // 4) * BYTES[format]
        assert k or linear == length
        pixels = getattr(texture2ddecoder, f"decode_{format}")(file[at : at + length], w, h)
        levels.append(np.frombuffer(pixels, np.uint8).reshape(h, w, 4)[..., [2, 1, 0, 3]] / 255)
        at += length
    assert at == len(file)
    return dxgi, levels


CASES = [
    ("bc1", PICTURE, 71, 32),
    ("bc3", np.concatenate([PICTURE, ALPHA], axis=-1), 77, 32),
    ("bc4", PICTURE[..., :1], 80, 38),
    ("bc5", PICTURE[..., :2], 83, 38),
    ("bc7", PICTURE, 98, 38),
    ("bc7", np.concatenate([PICTURE, ALPHA], axis=-1), 98, 36),
]


@pytest.mark.parametrize(("format", "picture", "number", "least"), CASES)
def test_every_level_is_what_was_written(tmp_path, format, picture, number, least):
    path = tmp_path / "a.dds"
    levels = chain(picture, 7)
    save_dds(path, levels, format)
    dxgi, found = read(path, format)
    assert dxgi == number and [level.shape[:2] for level in found] == [level.shape[:2] for level in levels]
    assert psnr(found[0][..., : picture.shape[-1]], picture) > least
    assert np.abs(found[-1][..., : picture.shape[-1]] - levels[-1]).max() < 0.02  # one texel
    assert picture.shape[-1] != 3 or found[0][..., 3].min() >= 254 / 255


@pytest.mark.parametrize(("format", "number"), [("bc1", 72), ("bc7", 99), ("bc4", 80)])
def test_srgb_is_said_where_the_format_can(tmp_path, format, number):
    save_dds(tmp_path / "a.dds", [PICTURE[..., : 1 if format == "bc4" else 3]], format, srgb=True)
    assert read(tmp_path / "a.dds", format)[0] == number


@pytest.mark.parametrize("format", ["bc1", "bc7"])
def test_pillow_reads_them(tmp_path, format):
    save_dds(tmp_path / "a.dds", chain(PICTURE, 3), format)
    with Image.open(tmp_path / "a.dds") as picture:
        assert picture.size == (101, 100)
        assert psnr(np.asarray(picture.convert("RGB")) / 255, PICTURE) > 32


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_halves(tmp_path, channels):
    values = np.random.default_rng(0).random((5, 3, channels)).astype(np.float32) * 1000
    save_dds(tmp_path / "a.dds", [values, values[:2, :1]], "half")
    file = (tmp_path / "a.dds").read_bytes()
    assert struct.unpack_from("<I", file, 128) == ((54,) if channels == 1 else (10,))
    assert struct.unpack_from("<I", file, 20) == (3 * (2 if channels == 1 else 8),)  # bytes a row
    halves = np.frombuffer(file[148:], "<f2")
    stored = 1 if channels == 1 else 4
    assert halves.size == 17 * stored
    found = halves[: 15 * stored].reshape(5, 3, stored)
    assert (found[..., :channels] == values.astype(np.float16)).all() and (channels != 3 or (found[..., 3] == 1).all())


def test_blocks_repeat_the_edge_and_clip():
    values = np.array([[[2.0], [-1.0]]], np.float32)
    block = np.frombuffer(texture2ddecoder.decode_bc4(encode_blocks(values, "bc4"), 4, 4), np.uint8).reshape(4, 4, 4)
    assert (block[..., 2] == [255, 0, 0, 0]).all()


def test_single_channels_take_the_nearest_of_eight_values():
    codes = np.random.default_rng(2).integers(0, 256, (64, 64)) // np.repeat([1, 3, 20, 90], 16)[:, None]
    blocks = encode_blocks(np.float32(codes[..., None] / 255), "bc4")
    found = np.frombuffer(texture2ddecoder.decode_bc4(blocks, 64, 64), np.uint8).reshape(64, 64, 4)[..., 2]
    spans = np.ptp(codes.reshape(16, 4, 16, 4), axis=(1, 3)).repeat(4, axis=0).repeat(4, axis=1)
    assert (np.abs(found.astype(int) - codes) < spans / 14 + 1).all()  # this decoder rounds down


BAD = [
    ([], "bc1", "of no levels"),
    ([PICTURE[..., :2]], "bc1", r"bc1 takes \[height, width, \(3,\) channels\]"),
    ([PICTURE[:0]], "bc7", r"\(0, 101, 3\)"),
    ([PICTURE, PICTURE], "bc7", "must halve"),
    ([PICTURE], "bc6", "choose from bc1"),
    ([np.full((4, 4, 1), np.nan)], "bc4", "NaN"),
    ([np.full((4, 4, 1), 1e5)], "half", "largest half"),
]


@pytest.mark.parametrize(("levels", "format", "message"), BAD)
def test_what_a_dds_cannot_hold_is_refused(tmp_path, levels, format, message):
    with pytest.raises(InputError, match=message):
        save_dds(tmp_path / "a.dds", levels, format)
    assert not list(tmp_path.iterdir())
