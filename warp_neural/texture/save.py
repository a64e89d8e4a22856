"""Maps as stored back into files that hold the same maps when they are read again."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from warp_neural.imaging.block_encoders import Quality
from warp_neural.imaging.block_texture import BlockTexture, Format, encode_levels
from warp_neural.imaging.dds import write_dds
from warp_neural.imaging.image import save_image, srgb_to_linear
from warp_neural.imaging.ktx2 import write_ktx2
from warp_neural.texture.state import Map

File = Literal["dds", "ktx2"]


def save_maps(
    folder: Path | str, arrays: Mapping[str, np.ndarray], maps: Sequence[Map], exr: bool = False
) -> list[Path]:
    """Write NAME.png of each of `arrays`, or NAME.exr where values go beyond [0, 1], as in hdr; returns the paths.

    arrays: [height, width, channels] as stored, those of `maps` that are wanted. PNG has as many bits as the file the
    map came from, values are clipped. exr: all as EXR, with colours decoded to linear light as is the custom there.
    """
    return [_save(Path(folder), arrays[each.name], each, exr) for each in maps if each.name in arrays]


def encode_maps(
    levels: Sequence[Mapping[str, np.ndarray]], maps: Sequence[Map], bc1: bool = False, quality: Quality = "fast"
) -> dict[str, BlockTexture]:
    """Those of `maps` that `levels`, the finest first, hold as stored, in the formats that GPUs read.

    Colours are BC7, or, with `bc1`, BC1 and BC3 where there is alpha; normals BC5 of x and y, from which z follows;
    one channel BC4; hdr and other values beyond [0, 1] halves. quality: see `encode_blocks`.
    """
    encoded = {}
    for each in maps:
        if each.name in levels[0]:
            format = dds_format(each, bc1)
            pictures = [_for_blocks(level[each.name], format) for level in levels]
            encoded[each.name] = encode_levels(pictures, format, each.kind == "srgb", quality, name=each.name)
    return encoded


def save_blocks(folder: Path | str, encoded: Mapping[str, BlockTexture], file: File = "dds") -> list[Path]:
    """Write NAME.dds or NAME.ktx2 of each; returns the paths."""
    write = {"dds": write_dds, "ktx2": write_ktx2}[file]
    paths = [Path(folder) / f"{name}.{file}" for name in encoded]
    for path, texture in zip(paths, encoded.values(), strict=True):
        write(path, texture)
    return paths


def dds_format(each: Map, bc1: bool = False) -> Format:
    if _beyond(each):
        return "half"
    if each.kind == "normal":
        return "bc5"
    if each.channels == 1 and each.kind != "srgb":  # BC4 is never sRGB
        return "bc4"
    return ("bc3" if each.channels in (2, 4) else "bc1") if bc1 else "bc7"


def _beyond(each: Map) -> bool:
    return each.kind == "hdr" or min(each.low) < 0 or max(each.high) > 1


def _save(folder: Path, values: np.ndarray, each: Map, exr: bool) -> Path:
    path = folder / f"{each.name}{'.exr' if exr or _beyond(each) else '.png'}"
    values = _of_four(values) if values.shape[-1] == 2 else values
    if path.suffix == ".png":
        save_image(path, values, color_space="linear", bits=each.bits)
    elif each.kind == "srgb":
        colours = srgb_to_linear(values[..., :3])
        save_image(path, np.concatenate([colours, values[..., 3:]], axis=-1), color_space="linear")
    else:
        save_image(path, values, color_space="linear")
    return path


def _for_blocks(values: np.ndarray, format: Format) -> np.ndarray:
    channels = values.shape[-1]
    if format == "bc5":
        return values[..., :2]
    if channels == 2:
        return _of_four(values)
    return np.broadcast_to(values, (*values.shape[:2], 3)) if channels == 1 and format in ("bc1", "bc7") else values


def _of_four(values: np.ndarray) -> np.ndarray:
    """Grey and alpha as red, green, blue and alpha."""
    return values[..., [0, 0, 0, 1]]
