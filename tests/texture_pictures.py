"""Pictures in files for tests of texture sets."""

import numpy as np
import pytest

from warp_neural.imaging.image import load_stored, save_image
from warp_neural.texture.kinds import to_maps

RNG = np.random.default_rng(3)


def codes(*shape, bits=8):
    """Values that a file of integers holds exactly."""
    return np.float32(RNG.integers(0, 2**bits, shape) / (2**bits - 1))


def put(path, values, **options):
    save_image(path, values, **({"color_space": "linear"} | options))
    return load_stored(path)[0]


def back(texture_set):
    return to_maps(texture_set.values, texture_set.maps)


def kinds(texture_set):
    return {each.name: each.kind for each in texture_set.maps}


@pytest.fixture
def folder(tmp_path):
    """What each file holds as stored, by the name of the map that it should be."""
    made = {
        "albedo": put(tmp_path / "Rock_2K-PNG_Color.png", codes(6, 10, 3)),
        "normal_dx": put(tmp_path / "Rock_2K-PNG_NormalDX.png", codes(6, 10, 3)),
        "gloss": put(tmp_path / "rock_gloss.png", codes(6, 10, bits=16), bits=16),
        "opacity": put(tmp_path / "rock_alpha.png", np.float32(RNG.random((6, 10)) < 0.4)),
        "wear mask": put(tmp_path / "wear mask.png", np.float32(RNG.random((6, 10)) < 0.4)),
        "emissive": put(tmp_path / "emissive.jpg", codes(6, 10, 3)),
        "flow": put(tmp_path / "flow.tif", codes(6, 10, 3)),
    }
    put(tmp_path / "Rock.png", codes(6, 10, 3))  # the asset's preview
    (tmp_path / "notes.txt").write_text("no picture")
    return tmp_path, made
