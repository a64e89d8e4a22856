"""OpenImageIO on bytes: what opens, reads and writes image files here. Its failures become `InputError`s.

It was chosen by one picture in some 700 files of all kinds, where imagecodecs, OpenCV and Pillow give other numbers,
and by 18,000 damaged files, none of which crashed it. It reads files by name only, and takes a "?" in one as the
beginning of options: hence the copies under names of our own.
"""

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from warp_neural.errors import InputError
from warp_neural.imaging.stored import check_size

_PREFIX = "warp-neural-"
_OWN_ERRORS = (RuntimeError, ValueError, MemoryError, OverflowError)  # UnicodeDecodeError is a ValueError


@contextmanager
def opened(data: bytes, suffix: str, path: Path) -> Iterator[oiio.ImageInput]:
    """The file `data` open for reading, alpha kept straight where it is; its size is checked. Errors name `path`."""
    with _copied(data, suffix, path) as copy:
        config = oiio.ImageSpec()
        config.attribute("oiio:UnassociatedAlpha", 1)
        try:
            file = oiio.ImageInput.open(str(copy), config)
            if file is None:
                raise _unreadable(path, oiio.geterror())
            try:
                check_size(path, file.spec().width, file.spec().height)
                yield file
            finally:
                file.close()
        except InputError:
            raise
        except _OWN_ERRORS as error:
            raise _unreadable(path, str(error)) from error


def read_pixels(file: oiio.ImageInput, path: Path, channels: tuple[int, int] | None = None) -> np.ndarray:
    """The current picture `[height, width, channels]` in the file's own type, of a range of channels or all."""
    spec = file.spec()
    low, high = channels or (0, spec.nchannels)
    formats = spec.channelformats or (spec.format,) * spec.nchannels
    place = file.current_subimage(), file.current_miplevel()
    pixels = file.read_image(*place, low, high, oiio.TypeDesc(formats[low]))
    error = file.geterror()
    if pixels is None or error:
        raise _unreadable(path, error)
    return pixels


@contextmanager
def _copied(data: bytes, suffix: str, path: Path) -> Iterator[Path]:
    """A file with the content `data`."""
    try:
        with _temporary(suffix) as copy:
            copy.write_bytes(data)
            yield copy
    except OSError as error:
        raise InputError(
            f"{path}: cannot be copied to a temporary file ({error.strerror}); set TMPDIR to a folder with room"
        ) from error


@contextmanager
def _temporary(suffix: str) -> Iterator[Path]:
    handle, name = tempfile.mkstemp(prefix=_PREFIX, suffix=suffix)
    os.close(handle)
    try:
        yield Path(name)
    finally:
        Path(name).unlink(missing_ok=True)


def _unreadable(path: Path, message: str) -> InputError:
    """OpenImageIO's first complaint, without the name of the copy: damage, or a feature that it does not read."""
    complaint = (message.strip().splitlines() or ["no picture in it"])[0]
    complaint = re.sub(rf"\S*{_PREFIX}\w+\.\w+", "the file", complaint)
    return InputError(f"{path}: cannot be read ({complaint}); export or copy it again")
