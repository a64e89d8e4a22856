"""TIFF: tifffile says what a file is and writes them, OpenImageIO decodes the codes, and what they mean is done here.

OpenImageIO leaves white as zero alone above 8 bits, and keeps 8 of the 16 bits of a palette. So both are read as plain
grey codes: the one tag that says otherwise is overwritten in the copy that it reads.
"""

import logging
import struct
from io import BytesIO
from pathlib import Path

import numpy as np
import tifffile

from warp_neural.errors import InputError
from warp_neural.imaging.openimageio import opened, read_pixels
from warp_neural.imaging.raster import check_cmyk, finished, levels_of
from warp_neural.imaging.stored import Stored, check_size, damaged, refused, straight

logging.getLogger("tifffile").addHandler(logging.NullHandler())  # or what it says of odd files goes to standard error

_WHITE_IS_ZERO, _GREY, _RGB, _PALETTE, _CMYK, _YCBCR = 0, 1, 2, 3, 5, 6
_PHOTOMETRIC = 262
_INTEGER, _FLOAT = 1, 3
_BITS = {_INTEGER: (1, 2, 4, 6, 8, 10, 12, 14, 16, 32), _FLOAT: (16, 32)}  # doubles it reads wrong in tiles and planes
_DIFFERENCES_ARE_KEPT = (5, 8, 32946, 34925, 50000)  # LZW, deflate, LZMA, Zstandard: a predictor goes with these
_KINDS = {_INTEGER: "integers", 2: "signed integers", _FLOAT: "floats", 4: "values of no stated type"}


def decode_tiff(data: bytes, path: Path) -> Stored:
    """The first picture of a TIFF. Raises `InputError`, naming `path`, for damage and for what is refused by name."""
    page = _first_page(data, path)
    _check_features(path, page)
    grey = page.photometric in (_WHITE_IS_ZERO, _PALETTE)
    with opened(_as_grey(data, page) if grey else data, ".tif", path) as file:
        spec = file.spec()
        check_cmyk(path, spec)
        codes = read_pixels(file, path)
    if page.photometric == _WHITE_IS_ZERO:
        codes[..., 0] = np.iinfo(codes.dtype).max - codes[..., 0]
    if page.photometric == _PALETTE:
        return Stored(finished(_colours(codes[..., 0], page, path), spec), levels_of(16), "srgb")
    premultiplied = tuple(page.extrasamples[:1]) == (1,)
    if page.sampleformat == _FLOAT:
        return Stored(finished(straight(codes) if premultiplied else codes, spec))
    if premultiplied:
        values = levels_of(page.bitspersample)[codes] if codes.itemsize < 4 else codes / (2**32 - 1)
        return Stored(finished(np.minimum(straight(values), 1), spec), None, "srgb")
    if codes.itemsize == 4:
        return Stored(finished(codes / (2**32 - 1), spec), None, "srgb")
    return Stored(finished(codes, spec), levels_of(page.bitspersample), "srgb")


def encode_tiff(codes: np.ndarray) -> bytes:
    """uint8, uint16 or float32 `[height, width, 1 | 3 | 4]`, alpha straight, to a deflated TIFF file."""
    out = BytesIO()
    grey = codes.shape[-1] == 1
    options = {"extrasamples": ["unassalpha"]} if codes.shape[-1] == 4 else {}
    options |= {"photometric": "minisblack" if grey else "rgb", "compression": "zlib", "metadata": None}
    tifffile.imwrite(out, codes.squeeze(-1) if grey else codes, **options)
    return out.getvalue()


def _first_page(data: bytes, path: Path) -> tifffile.TiffPage:
    try:
        with tifffile.TiffFile(BytesIO(data)) as tiff:
            page = tiff.pages[0]
            check_size(path, page.imagewidth, page.imagelength)
            for offset, count in zip(page.dataoffsets, page.databytecounts, strict=True):
                if offset == 0 or count == 0 or offset + count > len(data):  # libtiff would fill it with zeros
                    raise damaged(path, f"a part of the picture lies beyond the {len(data)} bytes of the file")
            return page
    except InputError:
        raise
    except Exception as error:  # of damaged files it lets any error of Python's through
        raise damaged(path, error) from error


def _check_features(path: Path, page: tifffile.TiffPage) -> None:
    """Refuse by name what would be read wrong, or with an error that says nothing."""
    bits, kind, photometric = page.bitspersample, page.sampleformat, page.photometric
    packed = bits not in (8, 16, 32)
    tag = page.tags.get(_PHOTOMETRIC)
    if tag is None or tag.dtype != 3:
        raise damaged(path, "a TIFF that does not say what its numbers stand for")
    if photometric not in (_WHITE_IS_ZERO, _GREY, _RGB, _PALETTE, _CMYK, _YCBCR):
        raise refused(path, f"the colour model {getattr(photometric, 'name', photometric)}", "save it as RGB")
    if bits not in _BITS.get(kind, ()):
        depth = f"TIFF of {bits}-bit {_KINDS.get(kind, 'complex numbers')}"
        raise refused(path, depth, "save it with 8 or 16 bits or as float32")
    if kind == _FLOAT and photometric not in (_GREY, _RGB):
        raise refused(path, "TIFF of floats that are no grey or RGB", "save it as RGB")
    if page.planarconfig == 2 and packed and page.samplesperpixel > 1:
        raise refused(path, f"TIFF of separate planes of {bits} bits", "save it with 8 or 16 bits")
    if photometric == _PALETTE and page.samplesperpixel > 1:
        raise refused(path, "a palette TIFF with further channels", "save it as RGBA")
    if page.predictor != 1 and (packed or page.compression not in _DIFFERENCES_ARE_KEPT):
        raise refused(path, f"the predictor {page.predictor} with this compression or depth", "save it without")
    if page.fillorder != 1 and page.compression not in (1, 2, 3, 4):
        raise refused(path, "a compressed TIFF with its bits in reverse", "save it again")
    if page.samplesperpixel > 5:
        raise refused(path, f"TIFF of {page.samplesperpixel} channels", "save it as grey, RGB or RGBA")


def _as_grey(data: bytes, page: tifffile.TiffPage) -> bytes:
    tag = page.tags[_PHOTOMETRIC]
    copy = bytearray(data)
    struct.pack_into(page.parent.byteorder + "H", copy, tag.valueoffset, _GREY)
    return bytes(copy)


def _colours(codes: np.ndarray, page: tifffile.TiffPage, path: Path) -> np.ndarray:
    """Scaled codes `[height, width]` to the palette's colours, uint16 `[height, width, 3]`."""
    top = 2**page.bitspersample - 1
    if page.colormap is None or page.colormap.shape != (3, top + 1):
        raise damaged(path, "a palette picture without its palette")
    index = np.rint(levels_of(page.bitspersample) * top).astype(np.intp)
    return page.colormap.T[index].astype(np.uint16)[codes]
