"""DDS and KTX 2.0 files come back as they were written, and damaged ones are refused."""

import struct

import numpy as np
import pytest
import texture2ddecoder
from skimage import data

from warp_neural.errors import InputError
from warp_neural.imaging.block_encoders import encode_blocks
from warp_neural.imaging.block_files import load_blocks
from warp_neural.imaging.block_texture import FORMATS, BlockTexture, encode_levels
from warp_neural.imaging.dds import save_dds, write_dds
from warp_neural.imaging.ktx2 import save_ktx2, write_ktx2

SAVE = {"dds": (save_dds, write_dds), "ktx2": (save_ktx2, write_ktx2)}
PICTURE = data.astronaut()[96:196, 150:251].astype(np.float32) / 255  # [100, 101, 3], a face
SIZES = [(100, 101), (64, 64), (1, 7), (5, 2)]
RNG = np.random.default_rng(8)


def random_texture(format, height=21, width=37, srgb=False):
    """Any bytes are blocks."""
    block, levels = FORMATS[format], []
    for k in range(max(height, width).bit_length()):
        rows, columns = (-(-max(side >> k, 1) // block.side) for side in (height, width))
        levels.append(RNG.bytes(rows * columns * block.bytes))
    return BlockTexture(format, height, width, tuple(levels), srgb, format not in ("bc3", "bc7", "half4"))


def chain(height, width, channels):
    values = np.dstack([PICTURE, PICTURE[..., :1]])[..., :channels]
    sizes = [(max(height >> k, 1), max(width >> k, 1)) for k in range(max(height, width).bit_length())]
    return [values[:h, :w] for h, w in sizes]


@pytest.mark.parametrize("kind", SAVE)
@pytest.mark.parametrize("format", FORMATS)
def test_blocks_come_back(kind, format, tmp_path):
    for srgb in (False, True)[: 1 + FORMATS[format].srgb]:
        texture = random_texture(format, srgb=srgb)
        SAVE[kind][1](tmp_path / "a", texture)
        assert load_blocks(tmp_path / "a") == texture


@pytest.mark.parametrize("kind", SAVE)
@pytest.mark.parametrize(("format", "channels"), [("bc1", 3), ("bc3", 4), ("bc4", 1), ("bc5", 2), ("bc7", 4)])
def test_pictures_of_any_size_are_what_a_decoder_reads(kind, format, channels, tmp_path):
    for height, width in SIZES:
        levels = chain(height, width, channels)
        SAVE[kind][0](tmp_path / "a", levels, format)
        found = load_blocks(tmp_path / "a")
        assert (found.height, found.width, len(found.levels)) == (height, width, len(levels))
        for k, (level, blocks) in enumerate(zip(levels, found.levels, strict=True)):
            assert blocks == encode_blocks(level, format)
            h, w = found.size(k)
            pixels = getattr(texture2ddecoder, f"decode_{format}")(blocks, w, h)
            codes = np.frombuffer(pixels, np.uint8).reshape(h, w, 4)[..., [2, 1, 0, 3]][..., :channels]
            assert np.abs(codes / 255 - level).mean() < 0.04


def test_levels_of_ktx2_lie_smallest_first_and_aligned(tmp_path):
    texture = random_texture("bc7", srgb=True)
    write_ktx2(tmp_path / "a", texture)
    file = (tmp_path / "a").read_bytes()
    assert file[:12].hex() == "ab4b5458203230bb0d0a1a0a"
    assert struct.unpack_from("<9I", file, 12) == (146, 1, 37, 21, 0, 0, 1, 6, 0)
    descriptor, size = struct.unpack_from("<2I", file, 48)
    assert (descriptor, size) == (80 + 6 * 24, 44)
    assert struct.unpack_from("<I8x4B4B", file, descriptor) == (44, 134, 1, 2, 0, 3, 3, 0, 0)
    places = [struct.unpack_from("<3Q", file, 80 + 24 * k) for k in range(6)]
    assert all(at % 16 == 0 and size == plain for at, size, plain in places)
    assert [file[at : at + size] for at, size, _ in places] == list(texture.levels)
    starts = [at for at, _, _ in places]
    assert starts == sorted(starts, reverse=True) and places[0][0] + places[0][1] == len(file)


def test_ktx2_says_which_of_bc3_is_alpha(tmp_path):
    """Khronos: alpha, bits 0 to 63, is linear in sRGB formats too."""
    write_ktx2(tmp_path / "a", random_texture("bc3", srgb=True))
    file = (tmp_path / "a").read_bytes()
    samples = struct.unpack_from("<I", file, 48)[0] + 28
    assert struct.unpack_from("<H2B12xH2B", file, samples) == (0, 63, 15 | 0x10, 64, 63, 0)


@pytest.mark.parametrize("name", ["DXT1", "DXT5", "ATI2"])
def test_older_dds_headers_are_read(name, tmp_path):
    texture = random_texture({"DXT1": "bc1", "DXT5": "bc3", "ATI2": "bc5"}[name])
    write_dds(tmp_path / "a", texture)
    file = (tmp_path / "a").read_bytes()
    (tmp_path / "a").write_bytes(file[:84] + name.encode() + file[88:128] + file[148:])
    assert load_blocks(tmp_path / "a") == texture


@pytest.mark.parametrize("kind", SAVE)
def test_files_cut_anywhere_or_too_long_are_refused(kind, tmp_path):
    SAVE[kind][1](tmp_path / "a", random_texture("bc1", 9, 13))
    file = (tmp_path / "a").read_bytes()
    for end in range(len(file)):
        (tmp_path / "a").write_bytes(file[:end])
        with pytest.raises(InputError, match=rf"{tmp_path}/a: [^\n]+$"):
            load_blocks(tmp_path / "a")
    (tmp_path / "a").write_bytes(file + b"\0")
    with pytest.raises(InputError, match="damaged"):
        load_blocks(tmp_path / "a")


@pytest.mark.parametrize("kind", SAVE)
def test_a_damaged_header_never_gives_other_blocks(kind, tmp_path):
    """It is refused, or, as where a side is another but has as many blocks, the blocks are the same."""
    texture, refused = random_texture("bc7", 9, 13), 0
    SAVE[kind][1](tmp_path / "a", texture)
    file = (tmp_path / "a").read_bytes()
    header = len(file) - sum(map(len, texture.levels))
    for bit in range(8 * header):
        damaged = bytearray(file)
        damaged[bit // 8] ^= 1 << bit % 8
        (tmp_path / "a").write_bytes(damaged)
        try:
            assert load_blocks(tmp_path / "a").levels == texture.levels
        except InputError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused > 2 * header


HOSTILE = [
    *(("dds", *row) for row in [(28, "I", 2**32 - 1), (12, "I", 2**31), (24, "I", 7), (112, "I", 0x200)]),
    *(("dds", *row) for row in [(128, "I", 95), (140, "I", 6)]),
    *(("ktx2", *row) for row in [(40, "I", 2**31), (40, "I", 0), (24, "I", 2**32 - 1), (44, "I", 2), (28, "I", 3)]),
    *(("ktx2", *row) for row in [(36, "I", 6), (12, "I", 9), (56, "I", 0), (64, "Q", 8), (48, "I", 2**32 - 4)]),
    *(("ktx2", *row) for row in [(80, "Q", 2**63), (88, "Q", 2**64 - 1), (80, "Q", 0)]),
]
"""the file, where in it, of what type, and the number that is put there"""


@pytest.mark.parametrize(("kind", "at", "type", "value"), HOSTILE)
def test_hostile_numbers_are_refused(kind, at, type, value, tmp_path):
    SAVE[kind][1](tmp_path / "a", random_texture("bc5"))
    file = bytearray((tmp_path / "a").read_bytes())
    struct.pack_into(f"<{type}", file, at, value)
    (tmp_path / "a").write_bytes(file)
    with pytest.raises(InputError, match=r"/a: [^\n]+; [^\n]+$"):
        load_blocks(tmp_path / "a")


BAD = [
    (("bc6", 4, 4, (bytes(8),)), "choose from bc1"),
    (("bc1", 4, 0, (bytes(8),)), "sides may be"),
    (("bc1", 4, 4, (bytes(16),)), "mip 0: 16 bytes; bc1 has 8"),
    (("bc1", 4, 4, ()), "0 mip levels"),
    (("bc1", 4, 4, (bytes(8),) * 4), "4 mip levels"),
    (("bc4", 4, 4, (bytes(8),), True), "bc4 is linear"),
]


@pytest.mark.parametrize(("fields", "message"), BAD)
def test_blocks_that_do_not_fit_are_refused(fields, message):
    with pytest.raises(InputError, match=message):
        BlockTexture(*fields)


def test_files_of_something_else_are_refused(tmp_path):
    (tmp_path / "a").write_bytes(b"\x89PNG")
    with pytest.raises(InputError, match=r"neither DDS nor KTX 2\.0"):
        load_blocks(tmp_path / "a")
    with pytest.raises(InputError, match="cannot be read"):
        load_blocks(tmp_path / "b")


def error_of(texture):
    pixels = getattr(texture2ddecoder, f"decode_{texture.format}")(texture.levels[0], 101, 100)
    return np.square(np.frombuffer(pixels, np.uint8).reshape(100, 101, 4)[..., 2::-1] / 255 - PICTURE).mean()


def test_the_best_colours_are_better():
    pytest.importorskip("quicktex", reason="needs quicktex")
    fast, best = (encode_levels([PICTURE], "bc1", quality=quality) for quality in ("fast", "best"))
    assert error_of(best) < 0.8 * error_of(fast)
    four = encode_levels([np.dstack([PICTURE, PICTURE[..., 0]])], "bc3", quality="best")
    assert error_of(four) == pytest.approx(error_of(best), rel=0.01)


def test_best_without_quicktex_is_refused(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "quicktex", None)
    with pytest.raises(InputError, match="needs quicktex"):
        encode_levels([PICTURE], "bc1", quality="best")
