"""Radiance HDR (RGBE): three 8-bit mantissas and a shared exponent. Ward, "Real Pixels", Graphics Gems II, 1991."""

import re

import numpy as np

from warp_neural.errors import InputError

_SIZE_LINE = re.compile(rb"-Y (\d{1,9}) \+X (\d{1,9})")
_HEADER_LIMIT = 2**16
_SHORTEST_RUN = 4  # below it a run costs as much as its literal bytes


def decode_hdr(data: bytes, path, max_pixels: int) -> np.ndarray:
    """The file's bytes to linear float32 `[height, width, 3]`, mantissa / 256 * 2^(exponent - 128), never negative.

    EXPOSURE and other header lines are ignored, as most readers do. Raises `InputError`, naming `path`, for damaged
    files, XYZE, flipped pictures and the run lengths of before 1991.
    """
    end = data.find(b"\n\n", 0, _HEADER_LIMIT)
    lines = data[:end].split(b"\n") if end >= 0 else []
    size_end = data.find(b"\n", end + 2, end + 64)
    size = _SIZE_LINE.fullmatch(data[end + 2 : size_end]) if size_end >= 0 else None
    if not lines or not size or b"FORMAT=32-bit_rle_xyze" in lines:
        raise InputError(f"{path}: not an RGBE picture stored as -Y height +X width; save it again as HDR or EXR")
    height, width = int(size[1]), int(size[2])
    if not 0 < height * width <= max_pixels:
        raise InputError(f"{path}: claims {width} x {height} pixels, more than {max_pixels} in all; scale it down")
    try:
        return _to_float(_decode_pixels(np.frombuffer(data, np.uint8, offset=size_end + 1), height, width))
    except (IndexError, ValueError) as error:
        raise InputError(f"{path}: the HDR's pixel data is cut short or damaged; export or copy it again") from error


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


def _decode_pixels(stream: np.ndarray, height: int, width: int) -> np.ndarray:
    """Bytes to RGBE `[height, width, 4]`; IndexError or ValueError when they do not fill it exactly."""
    start = bytes((2, 2, width >> 8 & 255, width & 255))
    if not 8 <= width < 32768 or stream[:4].tobytes() != start:
        flat = stream[: height * width * 4].reshape(height, width, 4)
        if (flat[..., :3] == 1).all(axis=-1).any():
            raise ValueError("run lengths of before 1991")
        return flat
    smallest_row = 4 + 8 * -(-width // 127)
    if stream.size < height * smallest_row:  # before memory is taken for it
        raise ValueError("truncated")
    rgbe = np.empty((height, 4, width), np.uint8)
    data, at = stream.tobytes(), 0
    for row in rgbe:
        if data[at : at + 4] != start:
            raise ValueError("scanline does not start")
        at = _decode_runs(data, at + 4, row.reshape(-1), width)
    return rgbe.transpose(0, 2, 1)


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
