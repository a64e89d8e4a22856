"""What a file holds before any colour is decoded, and the bytes it is read from."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from warp_neural.errors import InputError

ColorSpace = Literal["srgb", "linear"]

MAX_PIXELS = 2**27
"""The largest picture that is read, e.g. 16384 x 8192: a header that claims more is refused before memory is taken."""

MAX_BYTES = 16 * MAX_PIXELS + 2**20
"""The largest file that is read: four float32 channels of `MAX_PIXELS`, not compressed, and a header."""


@dataclass(frozen=True)
class Stored:
    """A picture `[height, width, 1 | 3 | 4]` as its file has it, upright, alpha last and straight."""

    pixels: np.ndarray
    """floats, or codes where there are `levels`"""
    levels: np.ndarray | None = None
    """float64, in [0, 1]: what each code stands for"""
    encoding: ColorSpace = "linear"
    """how such files are encoded by custom"""
    primaries: tuple[float, ...] | None = None
    """CIE x, y of red, green, blue and white, where the file says so"""


def read_file(path: Path) -> bytes:
    """All of a file. `InputError` for what is none (a folder, pipe or device would not end) or above `MAX_BYTES`."""
    try:
        size = path.stat().st_size
        if not path.is_file():
            raise InputError(f"{path}: cannot be read (a folder, pipe or device); give a file")
        if size > MAX_BYTES:
            raise InputError(f"{path}: {size} bytes, more than {MAX_BYTES}; scale the picture down")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the name and its permissions") from error
    except ValueError as error:  # a name with a null byte
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: cannot be read ({error}); check the name") from error


def check_size(path: Path, width: int, height: int) -> None:
    """Raises `InputError` for a picture that claims no pixels or too many, before memory is taken for it."""
    if width < 1 or height < 1 or width * height > MAX_PIXELS:
        raise InputError(
            f"{path}: claims {width} x {height} pixels, allowed are 1 to {MAX_PIXELS} in all; scale it down"
        )


def damaged(path: Path, error: object) -> InputError:
    """The error for a file whose content is cut short or altered."""
    return InputError(f"{path}: cut short or damaged ({' '.join(str(error).split())}); export or copy it again")


def refused(path: Path, feature: str, remedy: str) -> InputError:
    """The error for a sound file that uses what is not read here."""
    return InputError(f"{path}: {feature} is not read; {remedy}")


def straight(pixels: np.ndarray) -> np.ndarray:
    """Floats `[..., colours and alpha]`, premultiplied by alpha, to straight ones. Where alpha is 0 colours stay."""
    alpha = pixels[..., -1:]
    with np.errstate(all="ignore"):  # what is not finite then is refused where all values are looked at
        return np.concatenate([pixels[..., :-1] / np.where(alpha == 0, 1, alpha), alpha], axis=-1)
