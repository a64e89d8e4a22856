"""The one picture of the tests of image files, and what is asked of each file that holds it."""

import numpy as np
import pytest

from warp_neural.errors import InputError
from warp_neural.imaging.image import load_image

EXACT = 1e-7  # of float32
HEIGHT, WIDTH = 20, 24
RNG = np.random.default_rng(1)
PICTURE = RNG.random((HEIGHT, WIDTH, 4))
PICTURE[:6] = 0.25  # flat parts, for compressions
PICTURE[..., 3] = 0.2 + 0.8 * PICTURE[..., 3]
GREY, COLOUR = PICTURE[..., :1], PICTURE[..., :3]

UPRIGHT = {  # TIFF 6.0, page 36: how a picture stored with each orientation is to be seen
    1: lambda x: x,
    2: lambda x: x[:, ::-1],
    3: lambda x: x[::-1, ::-1],
    4: lambda x: x[::-1],
    5: lambda x: x.swapaxes(0, 1),
    6: lambda x: x.swapaxes(0, 1)[:, ::-1],
    7: lambda x: x[::-1, ::-1].swapaxes(0, 1),
    8: lambda x: x.swapaxes(0, 1)[::-1],
}


def codes_of(picture, bits):
    return np.rint(picture * (2**bits - 1)).astype(np.uint64)


def loads(path, data, expected, tolerance=EXACT):
    """`data` in the file `path` is `expected`: straight, upright values as encoded."""
    path.write_bytes(data)
    read = load_image(path, color_space="linear")
    assert read.shape == expected.shape and np.abs(read - expected).max() <= tolerance


def refused(path, data, words):
    path.write_bytes(data)
    with pytest.raises(InputError, match=words) as caught:
        load_image(path)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


def with_alpha(colours, alpha):
    return np.concatenate([np.broadcast_to(colours, (*colours.shape[:2], 3)), alpha], axis=-1)
