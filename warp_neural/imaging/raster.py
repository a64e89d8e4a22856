"""PNG and JPEG: stored values in, by OpenImageIO, and out; and what TIFF shares with them.

OpenImageIO does not write: on a full disk its JPEG ends the process and its PNG is cut short without a word.
"""

import struct
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from PIL import Image

from warp_neural.imaging.openimageio import opened, read_pixels
from warp_neural.imaging.stored import Stored, damaged, refused


def decode_png(data: bytes, path: Path) -> Stored:
    """Every PNG of 1 to 16 bits, palettes and transparent colours included.

    Raises `InputError`, naming `path`, here and below.
    """
    _check_chunks(data, path)
    return _decode(data, ".png", path)


def decode_jpeg(data: bytes, path: Path) -> Stored:
    """Every JPEG that libjpeg-turbo decodes; CMYK without a profile becomes (1 - c)(1 - k) and so on."""
    return _decode(data, ".jpg", path)


def encode_png(codes: np.ndarray) -> bytes:
    """uint8 or uint16 `[height, width, 1 | 3 | 4]` to a PNG file. By hand: Pillow writes no 16-bit colour."""
    height, width, channels = codes.shape
    raw = codes.astype(codes.dtype.newbyteorder(">"), order="C").view(np.uint8).reshape(height, -1)
    step = codes.itemsize * channels
    rows = np.full((height, 1 + raw.shape[1]), 1, np.uint8)  # filter 1: each byte less the one a pixel to its left
    rows[:, 1:] = raw
    rows[:, 1 + step :] -= raw[:, :-step]
    kind = {1: 0, 3: 2, 4: 6}[channels]
    header = struct.pack(">IIBBBBB", width, height, 8 * codes.itemsize, kind, 0, 0, 0)
    chunks = (b"IHDR", header), (b"IDAT", zlib.compress(rows, 6)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body)) for name, body in chunks
    )


def encode_jpeg(codes: np.ndarray) -> bytes:
    """uint8 `[height, width, 1 | 3]` to a JPEG file of quality 95 without chroma subsampling."""
    out = BytesIO()
    Image.fromarray(codes.squeeze(-1) if codes.shape[-1] == 1 else codes).save(out, "JPEG", quality=95, subsampling=0)
    return out.getvalue()


def levels_of(bits: int) -> np.ndarray:
    """What each code of a `bits`-bit file stands for; the library scaled them up to 8 or 16 bits, rounded down."""
    whole = 2 ** (8 if bits <= 8 else 16) - 1
    top = 2**bits - 1
    return np.rint(np.arange(whole + 1) * (top / whole)) / top


def finished(pixels: np.ndarray, spec: oiio.ImageSpec) -> np.ndarray:
    """Upright, and grey with alpha as RGBA."""
    if pixels.shape[-1] == 2:
        pixels = pixels[..., [0, 0, 0, 1]]
    return upright(pixels, spec.get_int_attribute("Orientation", 1))


def upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """`[rows, columns, ...]` as stored to how it is to be seen: TIFF 6.0, page 36; Exif uses the same numbers."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    down, right = orientation in (3, 4, 7, 8), orientation in (2, 3, 6, 7)
    return pixels[:: -1 if down else 1, :: -1 if right else 1]


def check_cmyk(path: Path, spec: oiio.ImageSpec) -> None:
    """Inks that a profile describes have no colours without it."""
    cmyk = "CMYK" in (spec.get_string_attribute("tiff:ColorSpace"), spec.get_string_attribute("jpeg:ColorSpace"))
    if cmyk and spec.get_string_attribute("ICCProfile:color_space") == "CMYK":
        raise refused(path, "CMYK with a colour profile", "convert it to sRGB")


def _decode(data: bytes, suffix: str, path: Path) -> Stored:
    with opened(data, suffix, path) as file:
        spec = file.spec()
        check_cmyk(path, spec)
        pixels = read_pixels(file, path)
    return Stored(finished(pixels, spec), levels_of(8 * pixels.itemsize), "srgb")


def _check_chunks(data: bytes, path: Path) -> None:
    """All chunks whole, before libpng sees them: it also complains on standard error."""
    at, name = 8, b""
    try:
        while name != b"IEND":
            size, name = struct.unpack_from(">I4s", data, at)
            (checksum,) = struct.unpack_from(">I", data, at + 8 + size)
            if zlib.crc32(data[at + 4 : at + 8 + size]) != checksum:
                raise damaged(path, f"checksum of the PNG's chunk {name.decode('ascii', 'replace')}")
            at += 12 + size
    except struct.error as error:
        raise damaged(path, "PNG without an end") from error
