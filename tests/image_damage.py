"""Reads randomly damaged image files: `python tests/image_damage.py FIRST COUNT`, by number, so any can be redone.

Each must load, or be refused by an `InputError` of one line, within 4 GiB of memory and a few seconds. For POSIX.
"""

import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import OpenEXR
from image_files import (
    DEFLATE,
    LZW,
    NONE,
    PACKBITS,
    PALETTE,
    PREMULTIPLIED,
    RGB,
    WHITE_IS_ZERO,
    png,
    tiff,
)
from PIL import Image

from warp_neural.errors import InputError
from warp_neural.imaging.image import load_exr, load_exr_mips, load_image, save_exr, save_exr_mips, save_image

MEMORY, SECONDS = 4 * 2**30, 10
RNG = np.random.default_rng(0)
PICTURE = RNG.random((40, 48, 4), dtype=np.float32)
PICTURE[:20] = 0.25


def sources(folder: Path) -> list[tuple[str, bytes]]:
    """Sound files of all formats, as (suffix, content)."""
    codes = {
        bits: np.rint(PICTURE.astype(np.float64) * (2**bits - 1)).astype(np.uint64) for bits in (1, 2, 4, 8, 12, 16)
    }
    files = [(".png", png(codes[bits][..., :1], bits, 0, transparent=b"\0\1")) for bits in (1, 4, 16)]
    files += [(".png", png(codes[8], 8, 6, interlaced=True)), (".png", png(codes[16][..., :3], 16, 2))]
    files += [(".png", png(codes[4][..., :1], 4, 3, palette=RNG.integers(0, 256, (16, 3)), transparent=b"\0\1\2"))]
    for compression in (NONE, LZW, DEFLATE, PACKBITS):
        for order in "<>":
            kind = {"compression": compression, "order": order}
            files += [(".tif", tiff(codes[bits][..., :1], bits, WHITE_IS_ZERO, **kind)) for bits in (1, 12, 16)]
            files += [(".tif", tiff(codes[8], 8, RGB, extra=PREMULTIPLIED, tile=16, **kind))]
            files += [(".tif", tiff(codes[4][..., :1], 4, PALETTE, color_map=range(48), **kind))]
            files += [(".tif", tiff(codes[16][..., :3], 16, RGB, planar=True, orientation=6, **kind))]
        files += [
            (".tif", tiff(PICTURE, 32, RGB, sample_format=3, predictor=3 if compression in (LZW, DEFLATE) else 1))
        ]
    colours = Image.fromarray(codes[8][..., :3].astype(np.uint8))
    for suffix, picture, options in (
        (".jpg", colours, {}),
        (".jpg", colours, {"progressive": True}),
        (".jpg", colours.convert("CMYK"), {}),
        (".jpg", colours.convert("L"), {}),
        (".tif", colours, {"compression": "jpeg"}),
        (".tif", colours.convert("1"), {"compression": "group3"}),
        (".tif", colours.convert("1"), {"compression": "group4"}),
    ):
        picture.save(folder / f"a{suffix}", **options)
        files.append((suffix, (folder / f"a{suffix}").read_bytes()))
    save_image(folder / "a.hdr", PICTURE[..., :3])
    save_image(folder / "flat.hdr", PICTURE[:, :7, :3])
    save_exr_mips(folder / "mips.exr", [PICTURE[: 32 >> k, : 32 >> k] for k in range(6)], "RGBA")
    for name in ("RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB", "NO"):
        kind = getattr(OpenEXR, f"{name}_COMPRESSION")
        channels = {c: PICTURE[..., k].astype(np.float16) for k, c in enumerate("RGBA")}
        save_exr(
            folder / f"{name}.exr",
            channels | {"id": np.arange(1920, dtype=np.uint32).reshape(40, 48)},
            compression=kind,
        )
        del channels["A"]
        save_exr(folder / f"{name}_RGB.exr", channels, compression=kind)
    files += [(path.suffix, path.read_bytes()) for path in sorted(folder.iterdir()) if path.suffix in (".hdr", ".exr")]
    return 3 * files[:20] + files + [file for file in files if file[0] in (".jpg", ".hdr", ".exr")]


def damage(data: bytes, rng: np.random.Generator) -> bytes:
    """Cut short, bytes altered anywhere or near the ends, where headers are, or a piece doubled or left out."""
    kind, changed = rng.integers(5), bytearray(data)
    at, size = rng.integers(len(data)), int(rng.integers(1, 65))
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[:at] + data[at + size :]
    if kind == 2:
        return data[:at] + data[max(0, at - size) : at] + data[at:]
    for _ in range(rng.integers(1, 9)):
        place = rng.integers(len(data)) if kind == 3 else rng.integers(-min(len(data), 400), min(len(data), 400))
        changed[place] = rng.choice([0, 1, 127, 128, 255, rng.integers(256)])
    return bytes(changed)


def main(first: int, count: int) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    read = {True: 0, False: 0}
    with tempfile.TemporaryDirectory() as folder:
        files = sources(Path(folder))
        for number in range(first, first + count):
            suffix, data = files[number % len(files)]
            path = Path(folder) / f"damaged{suffix}"
            path.write_bytes(damage(data, np.random.default_rng(number)))
            for load in (load_image, load_exr, load_exr_mips) if suffix == ".exr" else (load_image,):
                began = time.monotonic()
                print(f"\rnumber {number}, {load.__name__}{suffix}", end=" ", flush=True)
                try:
                    load(path)
                    read[True] += 1
                except InputError as error:
                    assert str(error).startswith(str(path)) and "\n" not in str(error), error
                    read[False] += 1
                assert time.monotonic() - began < SECONDS, "too slow"
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    print(f"\r{count} damaged files: {read[True]} read, {read[False]} refused, none crashed; {peak} MiB at most")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
