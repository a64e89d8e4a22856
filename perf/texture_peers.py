"""What a material's maps cost and become in block formats, picture formats and at smaller sizes.

Maps are uint8 [height, width, 3 or 1], values as stored. BC2 and BC3 are BC1 with an alpha, and BC6H is for HDR: none
of them says more about these maps. BC1, BC4 and BC5 are made by quicktex at its best, BC7 by etcpak, all decoded by
texture2ddecoder; `pip install -e '.[peers]'` brings them. Pillow writes the picture formats.
"""

import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec

import numpy as np

from warp_neural.errors import InputError

Maps = dict[str, np.ndarray]
BLOCKS = "BC1 to BC7"
QUALITIES = (5, 10, 15, 20, 25, 30, 40, 50, 60, 70, 80, 88, 94)
TARGETS = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)  # bits a texel that picture formats are to come close to
PICTURES = {  # name: the options that are tried at each quality, whichever is better for a map
    "JPEG": [{"subsampling": 0, "optimize": True}, {"subsampling": 2, "optimize": True}],
    "WebP": [{"method": 6}],
    "AVIF": [{"subsampling": "4:4:4"}],  # at its usual speed, 6; what slower ones gain was not measured
}


@dataclass(frozen=True)
class Coded:
    """Maps by one codec. size: bytes of all its files."""

    codec: str
    setting: str
    size: int
    maps: Maps


def check_installed(*others: str) -> None:
    missing = [name for name in ("etcpak", "quicktex", "texture2ddecoder", *others) if not find_spec(name)]
    if missing:
        raise InputError(f"{', '.join(missing)}: not installed; pip install -e '.[peers]'")


def all_coded(maps: Maps) -> list[Coded]:
    return [*block_formats(maps), *(coded for name in PICTURES for coded in pictures(name, maps)), *smaller(maps)]


def block_formats(maps: Maps) -> list[Coded]:
    """Maps of three channels in BC1, BC7 or, normals, BC5; of one in BC4 or three of them together in BC1 or BC7."""
    colours = [name for name, pixels in maps.items() if pixels.shape[2] == 3]
    singles = [name for name, pixels in maps.items() if pixels.shape[2] == 1]
    alone = [("BC4", (name,)) for name in singles]
    coded = []
    for block in ("BC1", "BC7"):
        plain = [(block, (name,)) for name in colours]
        normals = [("BC5" if name == "normal" else block, (name,)) for name in colours]
        together = [(block, tuple(singles[i : i + 3])) for i in range(0, len(singles), 3)]
        choices = {block: plain + together, f"{block}, BC4": plain + alone, f"{block}, BC5, BC4": normals + alone}
        coded += [block_format(setting, files, maps) for setting, files in choices.items()]
    return coded


def block_format(setting: str, files: list[tuple[str, tuple[str, ...]]], maps: Maps) -> Coded:
    """files: the format of each, and the maps whose channels it holds."""
    size, decoded = 0, {}
    for block, names in files:
        pixels = np.concatenate([maps[name] for name in names], axis=2)
        data, result = blocks(block, pixels.tobytes(), pixels.shape)
        size += data
        parts = np.split(result, np.cumsum([maps[name].shape[2] for name in names])[:-1], axis=2)
        decoded |= dict(zip(names, parts, strict=True))
    return Coded(BLOCKS, setting, size, {name: decoded[name] for name in maps})


@cache
def blocks(block: str, pixels: bytes, shape: tuple[int, int, int]) -> tuple[int, np.ndarray]:
    """The bytes of a picture of 1 to 3 channels in blocks of 4 x 4 texels, and what it decodes to."""
    import texture2ddecoder

    height, width, channels = shape
    image = np.frombuffer(pixels, np.uint8).reshape(shape)
    full = np.pad(image, ((0, -height % 4), (0, -width % 4), (0, 3 - channels)), mode="edge")
    if channels == 2:
        full[..., 2] = 0
    rgba = np.dstack([full, np.full(full.shape[:2], 255, np.uint8)])
    rows, columns = full.shape[:2]
    data = ENCODERS[block](rgba.tobytes(), columns, rows)
    bgra = getattr(texture2ddecoder, f"decode_{block.lower()}")(data, columns, rows)
    rgb = np.frombuffer(bgra, np.uint8).reshape(rows, columns, 4)[:height, :width, 2::-1]
    result = with_z(rgb) if block == "BC5" else rgb[..., :channels]
    return len(data), np.ascontiguousarray(result)


def with_z(xy: np.ndarray) -> np.ndarray:
    """Normals from their x and y, as a shader makes them."""
    x, y = (xy[..., c] / 127.5 - 1 for c in range(2))
    z = np.sqrt(np.maximum(1 - x * x - y * y, 0))
    return np.dstack([xy[..., :2], np.rint(127.5 * (z + 1)).astype(np.uint8)])


def bc1(rgba: bytes, width: int, height: int) -> bytes:
    from quicktex import RawTexture
    from quicktex.s3tc.bc1 import BC1Encoder

    return BC1Encoder(18).encode(RawTexture.frombytes(rgba, width, height)).tobytes()


def bc4(rgba: bytes, width: int, height: int) -> bytes:
    from quicktex import RawTexture
    from quicktex.s3tc.bc4 import BC4Encoder

    return BC4Encoder(0).encode(RawTexture.frombytes(rgba, width, height)).tobytes()


def bc5(rgba: bytes, width: int, height: int) -> bytes:
    from quicktex import RawTexture
    from quicktex.s3tc.bc5 import BC5Encoder

    return BC5Encoder(0, 1).encode(RawTexture.frombytes(rgba, width, height)).tobytes()


def bc7(rgba: bytes, width: int, height: int) -> bytes:
    import etcpak

    return etcpak.compress_bc7(rgba, width, height)


ENCODERS: dict[str, Callable[[bytes, int, int], bytes]] = {"BC1": bc1, "BC4": bc4, "BC5": bc5, "BC7": bc7}


@dataclass(frozen=True)
class Variant:
    """One map as one file. error: sum of squares of codes."""

    setting: str
    size: int
    error: float
    pixels: np.ndarray


def pictures(name: str, maps: Maps) -> list[Coded]:
    """A file a map; the qualities of the maps together give the least error for their bytes, near each of TARGETS."""
    variants = {each: [variant(name, pixels, options) for options in tried(name)] for each, pixels in maps.items()}
    found = {}
    for price in np.geomspace(1e-1, 1e4, 80):  # squared codes for a byte
        chosen = {each: min(some, key=lambda v: v.error + price * v.size) for each, some in variants.items()}
        found[sum(v.size for v in chosen.values())] = chosen
    texels = next(iter(maps.values()))[..., 0].size
    nearest = {min(found, key=lambda size: abs(np.log(8 * size / texels / target))) for target in TARGETS}
    return [
        Coded(
            name,
            ", ".join(f"{each} {v.setting}" for each, v in found[size].items()),
            size,
            {each: v.pixels for each, v in found[size].items()},
        )
        for size in sorted(nearest)
    ]


def tried(name: str) -> list[dict]:
    return [options | {"quality": quality} for quality in QUALITIES for options in PICTURES[name]]


def variant(name: str, pixels: np.ndarray, options: dict) -> Variant:
    from PIL import Image

    file = io.BytesIO()
    mode = "L" if pixels.shape[2] == 1 else "RGB"
    Image.fromarray(pixels.squeeze(2) if mode == "L" else pixels).save(file, name, **options)
    with Image.open(file) as image:
        decoded = np.asarray(image.convert(mode)).reshape(pixels.shape)
    error = np.square(decoded.astype(np.float32) - pixels).sum(dtype=np.float64)
    return Variant(str(options["quality"]), len(file.getvalue()), float(error), decoded)


def smaller(maps: Maps) -> list[Coded]:
    """Box filtered to a half, a quarter, an eighth of the side, 8 bits a channel, and cubic back."""
    coded = []
    for factor, setting in ((2, "half"), (4, "quarter"), (8, "eighth")):
        size, results = 0, {}
        for name, pixels in maps.items():
            planes = [resized(pixels[..., c], factor) for c in range(pixels.shape[2])]
            size += sum(small for small, _ in planes)
            results[name] = np.dstack([large for _, large in planes])
        coded.append(Coded("smaller", setting, size, results))
    return coded


def resized(plane: np.ndarray, factor: int) -> tuple[int, np.ndarray]:
    from PIL import Image

    height, width = plane.shape
    sides = max(width // factor, 1), max(height // factor, 1)
    small = Image.fromarray(plane).resize(sides, Image.Resampling.BOX)
    return sides[0] * sides[1], np.asarray(small.resize((width, height), Image.Resampling.BICUBIC))
