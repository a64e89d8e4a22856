"""Damaged and hostile `.wntc` files: refused in a line that names file and part, before memory is taken."""

import re
import tracemalloc
import zlib

import numpy as np
import pytest
from wntc_states import SMALL, make_state

from warp_neural.errors import InputError
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.texture import header
from warp_neural.texture.file import TextureFile, load_state, save_state, to_bytes
from warp_neural.texture.header import Header
from warp_neural.texture.sections import section, unsigned
from warp_neural.texture.state import Map

PARTS = r"header|network|contexts|index|latents|mip \d grid \d block \d+"


@pytest.fixture(scope="module")
def content():
    return to_bytes(make_state(TextureSpec(20, 24, 2, 2, SMALL, (4,)), seed=5))


def refused(path, data):
    path.write_bytes(data)
    with pytest.raises(InputError) as error:
        load_state(path)
    text = str(error.value)
    assert text.startswith(f"{path}: ") and "\n" not in text
    return text.removeprefix(f"{path}: ")


@pytest.mark.parametrize("mask", [0x01, 0x80, 0xFF])
def test_every_byte_counts(tmp_path, content, mask):
    for at in range(len(content)):
        text = refused(tmp_path / "a.wntc", content[:at] + bytes([content[at] ^ mask]) + content[at + 1 :])
        start = (
            "not a neural texture" if at < 4 else "version|header: an unknown version" if at == 4 else f"({PARTS}): "
        )
        assert re.match(start, text)


def test_the_part_is_named(tmp_path, content):
    (tmp_path / "a.wntc").write_bytes(content)
    file = TextureFile(tmp_path / "a.wntc")
    for (mip, grid), streams in file.streams.items():
        for block, start in enumerate(streams.starts[streams.sizes > 0]):
            data = bytearray(content)
            data[start] ^= 16
            assert refused(tmp_path / "b.wntc", data).startswith(f"mip {mip} grid {grid} block {block}: ")


def test_every_cut_is_refused(tmp_path, content):
    for length in range(len(content)):
        refused(tmp_path / "a.wntc", content[:length])
    assert "latents: 1 bytes too many" in refused(tmp_path / "a.wntc", content + b"\0")


def test_newer_versions_are_refused(tmp_path, content):
    text = refused(tmp_path / "a.wntc", content[:4] + b"\2" + content[5:])
    assert text == "version 2 of the format, written by a newer version; update warp-neural"


def test_no_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_state(tmp_path / "none.wntc")


def test_folders_are_refused(tmp_path):
    with pytest.raises(InputError):
        load_state(tmp_path)


def hostile(spec, network=b"", contexts=b"", index=b"", streams=b"", block=256):
    maps = tuple(Map(f"{c}", "linear", (0.0,), (1.0,)) for c in range(spec.channels))
    head = section(header.pack(Header(spec, block, maps, {})), b"WNTC\1")
    return head + b"".join(section(part) for part in (network, contexts, index)) + streams


EIGHT = TextureSpec(16384, 16384, 1, 1, tuple(Grid(1 << i, 32, "bilinear") for i in range(6)), (1,))


def same(tensors):
    """A network of zeros."""
    return bytes(2 * tensors) + b"\xff\0" * tensors


def contexts_of(spec, scale_0=0, used=True):
    """All channels, no weights but scale_0."""
    masks = [((1 << grid.channels) - 1) * used for grid in spec.grids]
    masks = b"".join(
        mask.to_bytes(-(-grid.channels // 8), "little") for mask, grid in zip(masks, spec.grids, strict=True)
    )
    which = (b"\xff\2" + b"\xff\0" * 6) * len(spec.grids)
    return masks + unsigned(len(which)) + which + (b"\xff" + unsigned(2 * scale_0) + b"\xff\0" * 6) * len(spec.grids)


def test_a_claim_of_gigabytes_takes_no_memory(tmp_path):
    data = hostile(EIGHT, same(4), contexts_of(EIGHT), bytes(800))
    assert len(data) < 1200
    tracemalloc.start()
    assert refused(tmp_path / "a.wntc", data).startswith("index: shorter than its blocks")
    assert tracemalloc.get_traced_memory()[1] < 2**22
    tracemalloc.stop()


def test_few_bytes_do_not_become_many_latents(tmp_path):
    """A right stream of four bytes: the longest run of zeros that it can stand for is checked before it is decoded."""
    spec = TextureSpec(256, 256, 1, 1, (Grid(1, 32, "bilinear"),), (1,))
    stream = (2**23).to_bytes(4, "big")
    index = unsigned(4) + zlib.crc32(stream).to_bytes(4, "little")
    data = hostile(spec, same(4), contexts_of(spec, 1), index, stream)
    assert refused(tmp_path / "a.wntc", data).startswith("mip 0 grid 0 block 0: ")


def test_streams_of_anything_end(tmp_path):
    """With right checksums: they are decoded, or refused, and never read beyond their end."""
    rng, spec = np.random.default_rng(0), TextureSpec(64, 64, 1, 1, (Grid(4, 5, "bilinear"),), (1,))
    for size in [*range(1, 12), 100, 3000]:
        stream = rng.bytes(size)
        index = unsigned(size) + zlib.crc32(stream).to_bytes(4, "little")
        data = hostile(spec, same(4), contexts_of(spec, int(rng.integers(1, 69))), index, stream)
        assert refused(tmp_path / "a.wntc", data).startswith("mip 0 grid 0 block 0: ")


def test_a_stream_of_one_mip_is_named_among_all(tmp_path):
    """Its checksum is right; the mips are decoded together."""
    spec, rng = TextureSpec(512, 256, 1, 2, (Grid(8, 5, "bilinear"),), (1,)), np.random.default_rng(1)
    stream = rng.bytes(300)
    for bad in range(3):
        streams = [stream if block == bad else b"" for block in range(3)]
        index = b"".join(
            unsigned(len(each)) + (zlib.crc32(each).to_bytes(4, "little") if each else b"") for each in streams
        )
        data = hostile(spec, same(4), contexts_of(spec, 20), index, b"".join(streams))
        expected = f"mip {bad // 2} grid 0 block {bad % 2}: "
        assert refused(tmp_path / "a.wntc", data).startswith(expected)


@pytest.mark.parametrize(
    "parts, part",
    [
        ({"network": b""}, "network"),
        ({"network": np.float16("nan").tobytes() * 4 + b"\xff\0" * 4}, "network"),
        ({"network": bytes(8) + b"\x40\0" * 4 + b"\0\0\0"}, "network"),
        ({"network": bytes(8) + b"\xff\xff\xff\xff\xff\x7f"}, "network"),
        ({"contexts": b"\xff"}, "contexts"),
        ({"contexts": b"\xff" + bytes(5)}, "contexts"),
        ({"index": b"\xff\xff\xff\xff\x7f" + bytes(4)}, "latents"),
        ({"index": b"\0\0"}, "index"),
        ({"block": 16}, "header"),
        ({"block": 16384}, "header"),
    ],
)
def test_parts_that_contradict_are_refused(tmp_path, parts, part):
    spec = TextureSpec(64, 64, 1, 1, (Grid(4, 5, "bilinear"),), (1,))
    right = {"network": same(4), "contexts": contexts_of(spec, 0, used=False), "index": b"\0"}
    path = tmp_path / "a.wntc"
    path.write_bytes(hostile(spec, **right))
    assert (load_state(path).latents[0][0] == 0).all()
    assert refused(path, hostile(spec, **right | parts)).startswith(f"{part}: ")


def test_headers_that_contradict_are_refused(tmp_path):
    spec = TextureSpec(64, 64, 1, 1, (Grid(4, 5, "bilinear"),), (1,))
    good = header.pack(Header(spec, 256, (Map("a", "linear", (0.0,), (1.0,)),), {}))
    for at in range(len(good)):
        for value in (0, 1, 127, 255):
            head = section(good[:at] + bytes([value]) + good[at + 1 :], b"WNTC\1")
            path = tmp_path / "a.wntc"
            path.write_bytes(head + section(b"") * 3)
            with pytest.raises(InputError) as error:
                TextureFile(path)
            assert re.match(rf"{re.escape(str(path))}: ({PARTS}): [^\n]+$", str(error.value))
    for text in (b"[]", b"{}", b"[[],[]]", b'[[["a","linear",[0],[1e999],"",8]],{}]', b"[" * 100_000, b"\xff", b"1"):
        assert refused(path, section(good[:16] + zlib.compress(text), b"WNTC\1")).startswith("header: ")


def test_a_text_that_inflates_without_end_is_refused(tmp_path):
    spec = TextureSpec(64, 64, 1, 1, (Grid(4, 5, "bilinear"),), (1,))
    good = header.pack(Header(spec, 256, (Map("a", "linear", (0.0,), (1.0,)),), {}))
    bomb = section(good[:16] + zlib.compress(b" " * 2**25), b"WNTC\1")
    assert refused(tmp_path / "a.wntc", bomb).startswith("header: maps cannot be read")


def test_an_old_file_stays_where_the_state_is_refused(tmp_path):
    state = make_state(TextureSpec(20, 24, 2, 2, SMALL, (4,)))
    save_state(tmp_path / "a.wntc", state)
    before = (tmp_path / "a.wntc").read_bytes()
    with pytest.raises(InputError):
        save_state(tmp_path / "a.wntc", make_state(state.spec, extra={"x": {1, 2}}))
    assert (tmp_path / "a.wntc").read_bytes() == before
