"""PNG, JPEG and TIFF by Pillow and tifffile: stored values in and out, no colour space."""

import struct
import warnings
import zlib
from io import BytesIO

import numpy as np
import tifffile
from PIL import Image

from warp_neural.errors import InputError

_DAMAGE = (
    OSError,
    SyntaxError,
    ValueError,
    EOFError,
    ArithmeticError,
    LookupError,
    TypeError,
    struct.error,
    zlib.error,
)
"""What Pillow and tifffile raise for damaged files, in the experience of cutting and altering some."""


def decode_pillow(data: bytes, path, max_pixels: int) -> np.ndarray:
    """PNG, JPEG or a TIFF that Pillow knows: uint8, uint16 or float32 `[height, width, 1 | 3 | 4]` as stored.

    Palettes become RGB or RGBA, grey with alpha RGBA, CMYK RGB. Orientation tags and colour profiles are ignored.
    Raises `InputError`, naming `path`.
    """
    try:
        with warnings.catch_warnings():
            # Pillow warns from 89 million pixels on, though the check below is the limit here, and of odd metadata,
            # which is not used; pixels that it cannot decode are errors
            warnings.filterwarnings("ignore", category=Image.DecompressionBombWarning)
            warnings.filterwarnings("ignore", category=UserWarning, module="PIL")
            with Image.open(BytesIO(data)) as picture:
                check_size(path, *picture.size, max_pixels)
                return _pixels(picture, data)
    except Image.DecompressionBombError as error:
        raise InputError(f"{path}: {error}; scale it down") from error
    except InputError:
        raise
    except _DAMAGE as error:
        raise damaged(path, error) from error


def decode_tiff(data: bytes, path, max_pixels: int) -> np.ndarray:
    """The first picture of a TIFF: uint8, uint16 or float32 `[height, width, 1 | 3 | 4]` as stored.

    Raises `InputError`, naming `path`, for damaged files and for compressions that neither tifffile nor Pillow reads.
    """
    try:
        with tifffile.TiffFile(BytesIO(data)) as tiff:
            page = tiff.pages[0]
            check_size(path, page.imagewidth, page.imagelength, max_pixels)
            plain = page.photometric in (tifffile.PHOTOMETRIC.MINISBLACK, tifffile.PHOTOMETRIC.RGB)
            if plain and page.compression in (1, 8, 32773, 32946):  # none, deflate, PackBits: no further package needed
                if page.samplesperpixel * page.imagewidth * page.imagelength > 4 * max_pixels:
                    raise InputError(f"{path}: {page.samplesperpixel} channels; save it as grey, RGB or RGBA")
                _check_segments(page, len(data))
                pixels = page.asarray()
                return _channels_last(np.moveaxis(pixels, 0, -1) if page.axes == "SYX" else pixels)
    except InputError:
        raise
    except _DAMAGE as error:
        raise damaged(path, error) from error
    return decode_pillow(data, path, max_pixels)


def encode_png(codes: np.ndarray) -> bytes:
    """uint8 or uint16 `[height, width, 1 | 3 | 4]` to a PNG file. Pillow writes no 16-bit colour, hence by hand."""
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


def encode_tiff(codes: np.ndarray) -> bytes:
    """uint8, uint16 or float32 `[height, width, 1 | 3 | 4]` to a TIFF file, deflated."""
    out = BytesIO()
    grey = codes.shape[-1] == 1
    extra = {"extrasamples": ["unassalpha"]} if codes.shape[-1] == 4 else {}
    tifffile.imwrite(
        out,
        codes.squeeze(-1) if grey else codes,
        photometric="minisblack" if grey else "rgb",
        compression="zlib",
        metadata=None,
        **extra,
    )
    return out.getvalue()


def check_size(path, width: int, height: int, max_pixels: int) -> None:
    """Raises `InputError` for a picture that claims no pixels or too many, before memory is taken for it."""
    if not 0 < width * height <= max_pixels:
        raise InputError(f"{path}: claims {width} x {height} pixels, allowed are 1 to {max_pixels} in all; scale it")


def damaged(path, error: object) -> InputError:
    """The error for a file whose content is cut short or altered."""
    return InputError(f"{path}: cut short or damaged ({' '.join(str(error).split())}); export or copy it again")


def _pixels(picture: Image.Image, data: bytes) -> np.ndarray:
    if picture.format == "PNG" and (sixteen := _SIXTEEN_BIT.get(picture.tile[0][3])):
        return sixteen(data)
    if picture.mode in ("P", "LA", "PA") or "transparency" in picture.info:
        picture = picture.convert("RGBA" if picture.has_transparency_data else "RGB")
    elif picture.mode in ("1", "CMYK", "YCbCr", "LAB", "HSV"):
        picture = picture.convert("L" if picture.mode == "1" else "RGB")
    return _channels_last(np.asarray(picture))


def _decode_as(data: bytes, mode: str, raw_mode: str) -> np.ndarray:
    """A PNG's pixels unpacked by another of Pillow's raw modes than the one it would choose."""
    with Image.open(BytesIO(data)) as picture:
        picture._mode = mode
        picture.tile = [(*picture.tile[0][:3], raw_mode)]
        return np.asarray(picture)


def _sixteen_bit_color(mode: str):
    """Pillow keeps 8 of a colour PNG's 16 bits: the high bytes as big-endian, so the low ones as little-endian."""

    def decode(data: bytes) -> np.ndarray:
        high, low = (_decode_as(data, mode, f"{mode};16{order}") for order in "BL")
        return high.astype(np.uint16) << 8 | low

    return decode


def _sixteen_bit_grey_alpha(data: bytes) -> np.ndarray:
    """Two big-endian values a pixel, which are four bytes as RGBA's are."""
    grey_alpha = np.ascontiguousarray(_decode_as(data, "RGBA", "RGBA")).view(">u2")
    return grey_alpha[..., [0, 0, 0, 1]].astype(np.uint16)


_SIXTEEN_BIT = {
    "RGB;16B": _sixteen_bit_color("RGB"),
    "RGBA;16B": _sixteen_bit_color("RGBA"),
    "LA;16B": _sixteen_bit_grey_alpha,
}


def _check_segments(page: tifffile.TiffPage, file_size: int) -> None:
    """tifffile fills missing strips and tiles with zeros: they must all be there."""
    for offset, count in zip(page.dataoffsets, page.databytecounts, strict=True):
        if offset == 0 or count == 0 or offset + count > file_size:
            raise ValueError(f"a part of the picture lies beyond the {file_size} bytes of the file")


def _channels_last(pixels: np.ndarray) -> np.ndarray:
    if pixels.ndim == 2:
        return pixels[..., None]
    if pixels.ndim == 3 and pixels.shape[-1] == 2:
        return pixels[..., [0, 0, 0, 1]]
    return pixels
