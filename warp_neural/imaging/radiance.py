"""Radiance HDR (RGBE): three 8-bit mantissas and a shared exponent.

Ward, "Real Pixels", Graphics Gems II, 1991; Ward, "Radiance File Formats", 1992, "Picture File Format" and the reader
in Radiance's own common/color.c. No library in reach reads them all: the run lengths from before 1991 are refused by
OpenImageIO, OpenCV and imagecodecs, wherever in a file they begin.
"""

import re
from pathlib import Path

import numpy as np

from warp_neural.imaging.stored import Stored, check_size, damaged, refused

_HEADER_LIMIT = 2**16
_SHORTEST_RUN = 4  # below it a run costs as much as its literal bytes
_SIZE_LINE = re.compile(rb"([+-])([XY]) (\d{1,9}) ([+-])([XY]) (\d{1,9})")
_DAMAGE = (IndexError, ValueError, OverflowError)


def decode_hdr(data: bytes, path: Path) -> Stored:
    """The file's bytes to linear `[height, width, 3]`, mantissa / 256 * 2^(exponent - 128), never negative.

    They are divided by the products of the header's EXPOSURE and COLORCORR, as the format says, which makes them the
    original radiances; PRIMARIES are handed on. Raises `InputError`, naming `path`, for damage and for XYZE.
    """
    lines, at = _header(data, path)
    kinds = [line for line in lines if line.startswith(b"FORMAT=")]
    if any(line.split(b"=", 1)[1].strip() == b"32-bit_rle_xyze" for line in kinds):
        raise refused(path, "Radiance XYZE (CIE colours)", "convert it with Radiance's ra_xyze -r")
    if any(line.split(b"=", 1)[1].strip() != b"32-bit_rle_rgbe" for line in kinds):
        raise refused(path, f"Radiance of {kinds[0].decode('ascii', 'replace')}", "save it as HDR or EXR")
    end = data.find(b"\n", at, at + 64)
    size = _SIZE_LINE.fullmatch(data[at:end].rstrip(b"\r")) if end >= 0 else None
    if not size or size[2] == size[5]:
        raise damaged(path, "no line with the picture's size")
    signs, first_is_y, counts = (size[1], size[4]), size[2] == b"Y", (int(size[3]), int(size[6]))
    check_size(path, *(counts[::-1] if first_is_y else counts))
    try:
        rgbe = _decode_scanlines(data, end + 1, *counts)
        pixels = _to_float(rgbe) / _exposure(lines)
        primaries = [values for values in _numbers(lines, b"PRIMARIES", 8) if any(values)]  # Photoshop writes zeros
    except _DAMAGE as error:
        raise damaged(path, error) from error
    flips = {b"Y": b"+", b"X": b"-"}  # the picture's top has the largest y, its left the smallest x
    pixels = pixels[:: -1 if signs[0] == flips[size[2]] else 1, :: -1 if signs[1] == flips[size[5]] else 1]
    return Stored(pixels if first_is_y else pixels.swapaxes(0, 1), primaries=primaries[-1] if primaries else None)


def encode_hdr(image: np.ndarray) -> bytes:
    """Linear `[height, width, 3]`, 0 to 1.7e38, to a whole HDR file: relative error at most 1/256 of a pixel's maximum.

    Raises `ValueError` for values that RGBE cannot hold.
    """
    height, width = image.shape[:2]
    rgbe = _to_rgbe(image)
    header = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width)
    if not 8 <= width < 32768:  # the sizes that run lengths are defined for
        return header + rgbe.tobytes()
    start = bytes((2, 2, width >> 8, width & 255))
    rows = (start + b"".join(_encode_runs(np.ascontiguousarray(row[:, k])) for k in range(4)) for row in rgbe)
    return header + b"".join(rows)


def _header(data: bytes, path: Path) -> tuple[list[bytes], int]:
    """The lines before the empty one, which ends the header, and where the next begins."""
    end = re.compile(rb"\n\r?\n").search(data, 0, _HEADER_LIMIT)
    if not end:
        raise damaged(path, "a header without an end")
    return [line.strip() for line in data[: end.start()].split(b"\n")], end.end()


def _numbers(lines: list[bytes], key: bytes, count: int) -> list[tuple[float, ...]]:
    """The values of every line KEY=, `count` numbers each."""
    texts = [line.split(b"=", 1)[1].split() for line in lines if line.startswith(key + b"=")]
    try:
        found = [tuple(map(float, text)) for text in texts]
    except ValueError:
        found = [()]
    if any(len(values) != count or not np.isfinite(values).all() for values in found):
        raise ValueError(f"{key.decode()} without its numbers, {count} in all")
    return found


def _exposure(lines: list[bytes]) -> np.ndarray:
    """[3]: what the picture was multiplied by."""
    factors = np.prod([1.0, *(values[0] for values in _numbers(lines, b"EXPOSURE", 1))])
    factors = factors * np.prod([(1.0, 1.0, 1.0), *_numbers(lines, b"COLORCORR", 3)], axis=0)
    if not (np.isfinite(factors) & (factors > 0)).all():
        raise ValueError("an EXPOSURE that is no positive number")
    return factors.astype(np.float32)


def _to_float(rgbe: np.ndarray) -> np.ndarray:
    exponent = rgbe[..., 3:].astype(np.int32)
    return np.where(exponent > 0, np.ldexp(rgbe[..., :3].astype(np.float32), exponent - 136), np.float32(0))


def _to_rgbe(image: np.ndarray) -> np.ndarray:
    largest = image.max(axis=-1)
    _, exponent = np.frexp(largest)
    exponent += np.ldexp(largest, 8 - exponent) >= 255.5  # would round to a mantissa of 256
    if image.min() < 0 or exponent.max() > 127:
        raise ValueError("Radiance HDR holds values from 0 to 1.7e38")
    mantissa = np.rint(np.ldexp(image, 8 - exponent[..., None]))
    rgbe = np.concatenate([mantissa, exponent[..., None] + 128], axis=-1)
    rgbe[(largest == 0) | (exponent < -127)] = 0  # zero has one spelling
    return rgbe.astype(np.uint8)


def _decode_scanlines(data: bytes, at: int, count: int, width: int) -> np.ndarray:
    """RGBE `[count, width, 4]`; IndexError or ValueError where bytes are missing. Each scanline by its own start."""
    rows = []
    for _ in range(count):
        start = data[at : at + 4]
        if 8 <= width < 32768 and start[:2] == b"\2\2" and len(start) == 4 and start[2] < 128:
            if start[2] << 8 | start[3] != width:
                raise ValueError("a scanline of another length")
            row = np.empty((4, width), np.uint8)
            at = _decode_runs(data, at + 4, row.reshape(-1), width)
            rows.append(row.T)
        else:
            row, at = _decode_old(data, at, width)
            rows.append(row)
    return np.stack(rows)


def _decode_old(data: bytes, at: int, width: int) -> tuple[np.ndarray, int]:
    """A scanline `[width, 4]` of pixels, where mantissas 1 1 1 repeat the pixel before as often as the exponent says.

    Counts of consecutive ones are digits of base 256, the lowest first. Returns where the next scanline starts too.
    """
    flat = np.frombuffer(data, np.uint8, min(4 * width, (len(data) - at) // 4 * 4), at).reshape(-1, 4)
    if len(flat) == width and not (flat[:, :3] == 1).all(axis=1).any():
        return flat, at + 4 * width
    row, filled, shift = np.empty((width, 4), np.uint8), 0, 0
    while filled < width:
        pixel = data[at : at + 4]
        if len(pixel) < 4:
            raise ValueError("truncated")
        at += 4
        length, shift = (pixel[3] << shift, shift + 8) if pixel[:3] == b"\1\1\1" else (1, 0)
        if filled + length > width or (shift and filled == 0):
            raise ValueError("a run past its scanline")
        row[filled : filled + length] = row[filled - 1] if shift else np.frombuffer(pixel, np.uint8)
        filled += length
    return row, at


def _decode_runs(data: bytes, at: int, row: np.ndarray, width: int) -> int:
    """Fill `row` [4 * width] from the run lengths at `data[at]`; returns where the next scanline starts."""
    filled = 0
    while filled < row.size:
        count = data[at]
        length = count - 128 if count > 128 else count
        stop = filled + length
        if length == 0 or stop > (filled // width + 1) * width:  # a run ends with its channel
            raise ValueError("run past the end of its channel")
        if count > 128:
            row[filled:stop] = data[at + 1]
            at += 2
        else:
            row[filled:stop] = np.frombuffer(data, np.uint8, length, at + 1)
            at += 1 + length
        filled = stop
    return at


def _encode_runs(values: np.ndarray) -> bytes:
    """One channel of a scanline: (128 + n, value) for a run, (n, n bytes) for literals; n at most 127 and 128."""
    edges = np.flatnonzero(np.diff(values)) + 1
    starts = np.concatenate([[0], edges])
    lengths = np.diff(np.concatenate([starts, [values.size]]))
    out, literal = bytearray(), 0  # literal: where the bytes that are in no run begin
    long = lengths >= _SHORTEST_RUN
    for start, length in zip(starts[long].tolist(), lengths[long].tolist(), strict=True):
        _append_literals(out, values[literal:start])
        for offset in range(0, length, 127):
            out += bytes((128 + min(127, length - offset), int(values[start])))
        literal = start + length
    _append_literals(out, values[literal:])
    return bytes(out)


def _append_literals(out: bytearray, values: np.ndarray) -> None:
    for offset in range(0, values.size, 128):
        piece = values[offset : offset + 128]
        out.append(piece.size)
        out += piece.tobytes()
