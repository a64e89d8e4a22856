"""OpenEXR files: any named channels, half, float or uint, every compression of the OpenEXR library.

OpenImageIO reads them: it says what is wrong where the OpenEXR module prints it. That module writes them: it alone
takes channels of several types at once.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO as oiio

from warp_neural.errors import InputError
from warp_neural.imaging.openimageio import opened, read_pixels
from warp_neural.imaging.stored import MAX_PIXELS, Stored, read_file, straight
from warp_neural.io.files import atomic_path

_MAX_TILE = 2**24
_PIXEL_TYPES = (np.float16, np.float32, np.uint32)


def load_exr(path: Path | str) -> dict[str, np.ndarray]:
    """Every channel of a single-part EXR by its name, as stored: float16, float32 or uint32 `[height, width]`.

    The pixels are those of the data window; values are not judged, so depth may be infinite; no colour is converted.
    Raises `InputError` for multi-part and deep files, subsampled channels and damaged files.
    """
    path = Path(path)
    with opened(read_file(path), ".exr", path) as file:
        check_parts(file, path)
        return read_channels(file, path)


def save_exr(
    path: Path | str, channels: Mapping[str, np.ndarray], *, compression: OpenEXR.Compression = OpenEXR.ZIP_COMPRESSION
) -> None:
    """Write named channels, each float16, float32 or uint32 `[height, width]` and all of one size, losslessly (ZIP).

    B44, DWAA and DWAB `compression` change values. Raises `InputError` for other dtypes or shapes, or if not writable.
    """
    path = Path(path)
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    file = OpenEXR.File(header, checked_channels(path, channels))
    with atomic_path(path) as temporary:
        try:
            file.write(str(temporary))
        except (RuntimeError, ValueError) as error:
            raise InputError(f"{path}: the EXR could not be written ({error}); nothing was changed") from error


def decode_exr(data: bytes, path: Path) -> Stored:
    """R, G, B and A, or the only channel, or Y with A, of the file `data`.

    EXR colours are premultiplied by alpha ("Technical Introduction to OpenEXR", Alpha), so they are divided by it.
    """
    with opened(data, ".exr", path) as file:
        check_parts(file, path)
        primaries = file.spec().getattribute("chromaticities")
        channels = read_channels(file, path)
    names = "".join(name for name in "YRGBA" if name in channels)
    if len(channels) == 1:
        (only,) = channels.values()
        return Stored(only[..., None].astype(np.float32))
    if names not in ("RGB", "RGBA", "YA"):
        raise InputError(f"{path}: channels {', '.join(channels)}, not R, G, B; read them with load_exr")
    pixels = np.stack([channels[name].astype(np.float32) for name in names.replace("YA", "YYYA")], axis=-1)
    primaries = tuple(float(x) for x in primaries) if primaries is not None and "R" in names else None
    return Stored(straight(pixels) if "A" in names else pixels, primaries=primaries)


def check_parts(file: oiio.ImageInput, path: Path) -> None:
    """Refuse, from the header alone, what is not one flat picture of a sensible size."""
    spec = file.spec()
    names = [spec.get_string_attribute("oiio:subimagename", "unnamed")]
    while len(names) < 99 and file.seek_subimage(len(names), 0):
        names.append(file.spec().get_string_attribute("oiio:subimagename", "unnamed"))
    file.geterror()  # there is no further part
    if len(names) > 1:
        raise InputError(
            f"{path}: multi-part EXR with the parts {', '.join(names)}; save the one you want as a single-part EXR"
        )
    file.seek_subimage(0, 0)
    if spec.deep:
        raise InputError(f"{path}: deep EXR (many samples a pixel); flatten it first")
    if spec.width * spec.height * max(1, spec.nchannels / 4) > MAX_PIXELS:
        raise InputError(
            f"{path}: claims {spec.width} x {spec.height} pixels of {spec.nchannels} channels, more than {MAX_PIXELS} "
            "of 4; scale it down"
        )
    if spec.tile_width * spec.tile_height > _MAX_TILE:  # memory is taken for whole tiles
        raise InputError(f"{path}: tiles of {spec.tile_width} x {spec.tile_height} pixels; save it with smaller ones")


def read_channels(file: oiio.ImageInput, path: Path) -> dict[str, np.ndarray]:
    """The channels of the current level, by name."""
    spec = file.spec()
    if not spec.channelformats:
        pixels = read_pixels(file, path)
        return {name: np.ascontiguousarray(pixels[..., k]) for k, name in enumerate(spec.channelnames)}
    return {name: read_pixels(file, path, (k, k + 1))[..., 0] for k, name in enumerate(spec.channelnames)}


def checked_channels(path: Path, channels: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """`channels` in memory as the library wants them, or an `InputError` that says what an EXR cannot hold."""
    pixels = {name: np.ascontiguousarray(values) for name, values in channels.items()}
    if not pixels:
        raise InputError(f"{path}: there is no channel to save; give at least one")
    shapes = {name: values.shape for name, values in pixels.items()}
    if len(set(shapes.values())) > 1 or any(len(shape) != 2 or 0 in shape for shape in shapes.values()):
        raise InputError(f"{path}: EXR channels must be [height, width] and of one size, not {shapes}")
    for name, values in pixels.items():
        if values.dtype not in _PIXEL_TYPES:
            raise InputError(f"{path}: channel {name} is {values.dtype}; convert it to float16, float32 or uint32")
    return pixels
