"""Images on disk from and to linear float32 arrays `[height, width, channels]`."""

from pathlib import Path

import numpy as np

from warp_neural.errors import InputError
from warp_neural.imaging.exr import decode_exr, load_exr, save_exr
from warp_neural.imaging.exr_mips import load_exr_mips, save_exr_mips
from warp_neural.imaging.primaries import to_rec_709
from warp_neural.imaging.radiance import decode_hdr, encode_hdr
from warp_neural.imaging.raster import decode_jpeg, decode_png, encode_jpeg, encode_png
from warp_neural.imaging.stored import ColorSpace, Stored, read_file
from warp_neural.imaging.tiff import decode_tiff, encode_tiff
from warp_neural.io.files import atomic_path

__all__ = [
    "linear_to_srgb",
    "load_exr",
    "load_exr_mips",
    "load_image",
    "load_stored",
    "save_exr",
    "save_exr_mips",
    "save_image",
    "srgb_to_linear",
    "suffixes",
]

_SUFFIXES = {
    ".png": "PNG",
    ".jpg": "JPEG",
    ".jpeg": "JPEG",
    ".tif": "TIFF",
    ".tiff": "TIFF",
    ".hdr": "Radiance HDR",
    ".exr": "EXR",
}
_MAGIC = {
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"\xff\xd8\xff": "JPEG",
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
    b"II+\0": "TIFF",
    b"MM\0+": "TIFF",
    b"#?": "Radiance HDR",
    b"\x76\x2f\x31\x01": "EXR",
}
_BITS = {"PNG": (8, 16), "JPEG": (8,), "TIFF": (8, 16, 32), "Radiance HDR": (8,), "EXR": (32, 16)}
"""Bits a channel; the first is the default."""

_JPEG_SIDE = 65500  # libjpeg's limit


def load_image(path: Path | str, *, color_space: ColorSpace | None = None) -> np.ndarray:
    """PNG, JPEG, TIFF, Radiance HDR or EXR as linear float32 `[height, width, channels]`.

    Channels: 1 (grey), 3 (RGB) or 4 (RGBA). Alpha is straight, colours are not multiplied by it, and never decoded from
    sRGB. Integer files give values in [0, 1], code / largest code; float files theirs, which may be negative or above 1
    but always finite. Orientation tags are obeyed. Of an EXR, R G B (A) or the only channel is taken; of a TIFF the
    first picture.

    `color_space` says how the FILE is encoded. None: it holds colours, srgb for integer files and linear for float
    ones, and primaries that an EXR or Radiance file states are converted to those of sRGB (Rec. 709). Pass "linear" for
    data such as roughness or normals. ICC profiles are ignored, but a CMYK file with one is refused.

    Raises `InputError` for a file that is missing, damaged, too large, of another format than its suffix says, uses a
    feature that is not read (the error names it), or holds NaN or infinite values.
    """
    path = Path(path)
    _check_color_space(path, color_space)
    return np.ascontiguousarray(_to_linear(path, _decode(path, _format_of(path)), color_space))


def load_stored(path: Path | str) -> tuple[np.ndarray, int]:
    """The file's values as they are, no colour converted, and its bits a channel: 8, 16, or 32 for floats.

    Otherwise as `load_image` with "linear".
    """
    path = Path(path)
    stored = _decode(path, _format_of(path))
    bits = 32 if stored.encoding == "linear" else 8 if stored.levels is not None and len(stored.levels) == 256 else 16
    return np.ascontiguousarray(_to_linear(path, stored, "linear")), bits


def displayed_psnr(truth: np.ndarray, picture: np.ndarray) -> float:
    """Peak signal-to-noise ratio in dB of displayed values in [0, 1], of any shape; 120 at most."""
    return float(-10 * np.log10(max(np.square(truth - picture, dtype=np.float64).mean(), 1e-12)))


def save_image(
    path: Path | str, image: np.ndarray, *, color_space: ColorSpace | None = None, bits: int | None = None
) -> None:
    """Write a linear float image `[height, width]` or `[height, width, 1 | 3 | 4]`, whole or not at all.

    The suffix chooses the format: PNG (8 or 16 `bits` a channel, 8 the default), JPEG (8), TIFF (8, 16, or 32: float),
    Radiance HDR (its own 8 with a shared exponent; grey becomes RGB) or EXR (32, the default, or 16: half).
    `color_space` is the encoding of the FILE: None means srgb for integer formats and linear for float ones. Integer
    formats clip to [0, 1]; alpha is straight here, never encoded to sRGB, and premultiplied in EXR, where colours under
    an alpha of 0 become black.

    Raises `InputError` for NaN or infinite values, other shapes and dtypes, and what the format cannot hold.
    """
    path = Path(path)
    _check_color_space(path, color_space)
    file_format = _format_of(path)
    bits = _BITS[file_format][0] if bits is None else bits
    if bits not in _BITS[file_format]:
        raise InputError(f"{path}: {file_format} with bits={bits}; choose from {sorted(_BITS[file_format])}")
    image = _checked(path, image, file_format)
    is_float = file_format in ("EXR", "Radiance HDR") or bits == 32
    if (color_space or ("linear" if is_float else "srgb")) == "srgb":
        image = np.concatenate([linear_to_srgb(image[..., :3]), image[..., 3:]], axis=-1)
    if file_format == "EXR":
        return _save_exr_image(path, image, bits)
    with atomic_path(path) as temporary:
        temporary.write_bytes(_encode(path, image, file_format, bits))


def suffixes() -> tuple[str, ...]:
    """The file suffixes that can be read and written, lower case with the dot."""
    return tuple(_SUFFIXES)


def srgb_to_linear(x: np.ndarray) -> np.ndarray:
    """sRGB-encoded values to linear ones (IEC 61966-2-1), float in and out, [0, 1] to [0, 1].

    Below 0 the straight piece goes on, above 1 the power.
    """
    return np.where(x <= 0.04045, x / 12.92, ((np.maximum(x, 0.04045) + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(x: np.ndarray) -> np.ndarray:
    """Linear values to sRGB-encoded ones (IEC 61966-2-1), float in and out: the inverse of `srgb_to_linear`."""
    return np.where(x <= 0.0031308, x * 12.92, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055)


def _check_color_space(path: Path, color_space: str | None) -> None:
    if color_space not in (None, "srgb", "linear"):
        raise InputError(f"{path}: color_space={color_space!r}; choose 'srgb', 'linear' or None")


def _format_of(path: Path) -> str:
    try:
        return _SUFFIXES[path.suffix.lower()]
    except KeyError:
        raise InputError(f"{path}: unknown suffix {path.suffix!r}; use one of {', '.join(_SUFFIXES)}") from None


def _decode(path: Path, file_format: str) -> Stored:
    """The file's stored values, after a look at what the content says it is."""
    data = read_file(path)
    content = next((name for magic, name in _MAGIC.items() if data.startswith(magic)), None)
    if content != file_format:
        remedy = "rename it" if content else "export or copy it again"
        raise InputError(f"{path}: its content is {content or 'no known image'}, not {file_format}; {remedy}")
    stored = _DECODERS[file_format](data, path)
    if stored.pixels.ndim != 3 or stored.pixels.shape[-1] not in (1, 3, 4):
        raise InputError(f"{path}: an array of shape {stored.pixels.shape}; save it as grey, RGB or RGBA")
    return stored


def _to_linear(path: Path, stored: Stored, color_space: ColorSpace | None) -> np.ndarray:
    encoded = (color_space or stored.encoding) == "srgb"
    if stored.levels is not None:
        linear = stored.levels.astype(np.float32)[stored.pixels]
        if encoded:
            linear[..., :3] = srgb_to_linear(stored.levels).astype(np.float32)[stored.pixels[..., :3]]
        return linear
    with np.errstate(over="ignore", invalid="ignore"):  # what is beyond float32 becomes infinite and is refused here
        linear = stored.pixels.astype(np.float32)
        if encoded:
            linear[..., :3] = srgb_to_linear(stored.pixels[..., :3])
        if color_space is None and stored.primaries and linear.shape[-1] >= 3:
            linear = _of_rec_709(path, linear, stored.primaries)
    if not np.isfinite(linear).all():
        raise InputError(f"{path}: holds NaN or infinite values; repair them before use")
    return linear


def _of_rec_709(path: Path, linear: np.ndarray, primaries: tuple[float, ...]) -> np.ndarray:
    try:
        return to_rec_709(linear, primaries)
    except ValueError as error:
        raise InputError(f"{path}: its {error} are those of no colours; pass color_space='linear'") from error


def _checked(path: Path, image: np.ndarray, file_format: str) -> np.ndarray:
    """`image` as float32 `[height, width, channels]`, or an `InputError` that says why it cannot be saved so."""
    image = np.asarray(image)
    if image.dtype.kind != "f":
        raise InputError(f"{path}: values of type {image.dtype}; give linear floats")
    allowed = (1, 3) if file_format in ("JPEG", "Radiance HDR") else (1, 3, 4)
    shaped = image[..., None] if image.ndim == 2 else image
    if shaped.ndim != 3 or shaped.shape[-1] not in allowed or 0 in shaped.shape:
        raise InputError(f"{path}: an image of shape {image.shape}; {file_format} takes {allowed} channels")
    if file_format == "JPEG" and max(shaped.shape[:2]) > _JPEG_SIDE:
        raise InputError(
            f"{path}: {shaped.shape[1]} x {shaped.shape[0]} pixels; a JPEG has {_JPEG_SIDE} a side at most"
        )
    with np.errstate(over="ignore"):  # a float64 beyond float32 becomes infinite and is refused here
        shaped = shaped.astype(np.float32)
    if not np.isfinite(shaped).all():
        raise InputError(f"{path}: NaN or infinite values are not saved; repair the image first")
    return shaped


def _encode(path: Path, image: np.ndarray, file_format: str, bits: int) -> bytes:
    if file_format == "Radiance HDR":
        try:
            return encode_hdr(np.broadcast_to(image, (*image.shape[:2], 3)))
        except ValueError as error:
            raise InputError(f"{path}: {error}; clip the image or save it as EXR") from error
    if bits < 32:
        top = 2**bits - 1
        image = np.rint(np.clip(image, 0, 1) * np.float32(top)).astype(np.uint8 if bits == 8 else np.uint16)
    return {"PNG": encode_png, "JPEG": encode_jpeg, "TIFF": encode_tiff}[file_format](image)


def _save_exr_image(path: Path, image: np.ndarray, bits: int) -> None:
    if image.shape[-1] == 4:  # premultiplied, by the format's custom
        image = np.concatenate([image[..., :3] * image[..., 3:], image[..., 3:]], axis=-1)
    dtype = np.float16 if bits == 16 else np.float32
    if bits == 16 and np.abs(image).max() >= 65520:  # rounds to infinity
        raise InputError(f"{path}: values beyond 65504, the largest half; save with bits=32")
    names = "RGBA" if image.shape[-1] > 1 else "Y"
    save_exr(path, {name: image[..., k].astype(dtype) for k, name in enumerate(names[: image.shape[-1]])})


_DECODERS = {
    "PNG": decode_png,
    "JPEG": decode_jpeg,
    "TIFF": decode_tiff,
    "Radiance HDR": decode_hdr,
    "EXR": decode_exr,
}
