"""Image files put together from their specifications, by none of the libraries that read them.

PNG: W3C, "Portable Network Graphics", third edition. TIFF: Adobe, "TIFF 6.0" and its "Technical Notes" 1 to 3 (2002).
"""

import struct
import zlib

import numpy as np

NONE, LZW, DEFLATE, PACKBITS = 1, 5, 8, 32773  # TIFF compressions
WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE, CMYK = 0, 1, 2, 3, 5  # TIFF photometric interpretations
PREMULTIPLIED, STRAIGHT = 1, 2  # TIFF extra samples

_ADAM_7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))


def pack_bits(codes, bits):
    """Unsigned codes `[rows, values]` to bytes `[rows, ...]`: highest bit first, every row from a whole byte."""
    places = np.arange(bits - 1, -1, -1, dtype=np.uint64)
    return np.packbits(
        (codes[..., None].astype(np.uint64) >> places & np.uint64(1)).reshape(len(codes), -1) != 0, axis=1
    )


def png(codes, bits, kind, *, palette=None, transparent=None, interlaced=False):
    """Codes `[height, width, channels]` to a PNG of colour type `kind`; `transparent` are the bytes of tRNS."""
    height, width = codes.shape[:2]
    passes = [codes[y::down, x::right] for x, y, right, down in (_ADAM_7 if interlaced else [(0, 0, 1, 1)])]
    raw = b"".join(
        b"\0" + row.tobytes() for part in passes if part.size for row in pack_bits(part.reshape(len(part), -1), bits)
    )
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, interlaced))]
    chunks += [(b"PLTE", np.asarray(palette, np.uint8).tobytes())] if palette is not None else []
    chunks += [(b"tRNS", transparent)] if transparent is not None else []
    chunks += [(b"IDAT", zlib.compress(raw)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body)) for name, body in chunks
    )


def tiff(
    values,
    bits,
    photometric,
    *,
    order="<",
    compression=NONE,
    predictor=1,
    planar=False,
    tile=None,
    orientation=None,
    extra=None,
    color_map=None,
    sample_format=None,
    more=(),
):
    """`[height, width, channels]` to a TIFF: codes below 2^bits, or floats with `sample_format=3`.

    `tile` is a side in pixels; without it there are strips of 7 rows. `more` are further (tag, type, values).
    """
    height, width, channels = values.shape
    planes = np.split(values, channels, axis=-1) if planar else [values]
    side = (tile, tile) if tile else (7, width)
    pieces = [
        _compress(_rows(piece, bits, order, predictor), compression, len(piece))
        for plane in planes
        for piece in _cut(plane, side, bool(tile))
    ]
    tags = [(256, 4, [width]), (257, 4, [height]), (258, 3, [bits] * channels), (259, 3, [compression])]
    tags += [(262, 3, [photometric]), (277, 3, [channels]), (284, 3, [2 if planar else 1]), (317, 3, [predictor])]
    tags += [(322, 4, [tile]), (323, 4, [tile])] if tile else [(278, 4, [7])]
    tags += [(274, 3, [orientation])] if orientation else []
    tags += [(338, 3, [extra])] if extra is not None else []
    tags += [(320, 3, list(color_map))] if color_map is not None else []
    tags += [(339, 3, [sample_format] * channels)] if sample_format else []
    return tiff_of_tags([*tags, *more], pieces, order, (324, 325) if tile else (273, 279))


def tiff_of_tags(tags, pieces, order="<", places=(273, 279)):
    """A TIFF of `tags` (tag, type, values) and compressed `pieces`, whose offsets and sizes are the tags `places`."""
    at, body = 8, b"".join(pieces)
    offsets = (at + np.cumsum([0] + [len(piece) for piece in pieces[:-1]])).tolist()
    tags = sorted([*tags, (places[0], 4, offsets), (places[1], 4, [len(piece) for piece in pieces])])
    body += b"\0" * (len(body) % 2)
    directory, spill = at + len(body), at + len(body) + 2 + 12 * len(tags) + 4
    entries, more = struct.pack(order + "H", len(tags)), b""
    for tag, kind, values in tags:
        data = struct.pack(f"{order}{len(values)}{ {1: 'B', 3: 'H', 4: 'I', 7: 'B', 12: 'd'}[kind] }", *values)
        if len(data) > 4:
            field = struct.pack(order + "I", spill + len(more))
            more += data + b"\0" * (len(data) % 2)
        else:
            field = data.ljust(4, b"\0")
        entries += struct.pack(order + "HHI", tag, kind, len(values)) + field
    head = {"<": b"II", ">": b"MM"}[order] + struct.pack(order + "HI", 42, directory)
    return head + body + entries + struct.pack(order + "I", 0) + more


def _cut(plane, side, pad):
    height, width, _ = plane.shape
    for y in range(0, height, side[0]):
        for x in range(0, width, side[1]):
            piece = plane[y : y + side[0], x : x + side[1]]
            if pad:
                piece = np.pad(piece, ((0, side[0] - piece.shape[0]), (0, side[1] - piece.shape[1]), (0, 0)))
            yield piece


def _rows(piece, bits, order, predictor):
    """The piece's bytes before compression, predicted as TIFF 6.0 section 14 or Technical Note 3 says."""
    height, _, channels = piece.shape
    if piece.dtype.kind == "f":
        rows = piece.astype(f"{order}f{bits // 8}").reshape(height, -1)
        return _predict_float(rows, channels) if predictor == 3 else rows.tobytes()
    if predictor == 2:
        piece = np.diff(piece.astype(np.int64), axis=1, prepend=0) % 2**bits
    codes = piece.reshape(height, -1)
    if bits in (8, 16, 24, 32):
        whole = codes.astype(f"{order}u8").view(np.uint8).reshape(height, -1, 8)
        return (whole[..., : bits // 8] if order == "<" else whole[..., 8 - bits // 8 :]).tobytes()
    return pack_bits(codes, bits).tobytes()


def _predict_float(rows, channels):
    """Technical Note 3: bytes of equal significance side by side, the highest first, then horizontal differences."""
    size = rows.itemsize
    planes = (
        rows.astype(f">f{size}").view(np.uint8).reshape(len(rows), -1, size).transpose(0, 2, 1).reshape(len(rows), -1)
    )
    result = planes.copy()
    result[:, channels:] -= planes[:, :-channels]
    return result.tobytes()


def _compress(data, compression, rows):
    if compression == PACKBITS:  # each row for itself
        size = len(data) // rows
        return b"".join(_pack_literals(data[at : at + size]) for at in range(0, len(data), size))
    return {NONE: bytes, LZW: _lzw, DEFLATE: zlib.compress}[compression](data)


def _lzw(data):
    """LZW without any repetition found: every byte its own 9-bit code, and a new table before codes grow."""
    codes = []
    for at in range(0, len(data), 200):
        codes += [256, *data[at : at + 200]]
    return pack_bits(np.array([[*codes, 257]]), 9).tobytes()


def _pack_literals(data):
    return b"".join(bytes((len(data[at : at + 128]) - 1,)) + data[at : at + 128] for at in range(0, len(data), 128))
