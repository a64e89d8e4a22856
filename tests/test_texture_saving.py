"""Maps back to files: PNG, EXR, DDS."""

import struct

import numpy as np
from texture_pictures import back, codes, folder, kinds, put

from warp_neural.imaging.image import linear_to_srgb, load_stored
from warp_neural.texture.kinds import to_maps
from warp_neural.texture.maps import load_set, mip_chain
from warp_neural.texture.save import dds_format, encode_maps, save_blocks, save_maps

__all__ = ["folder"]  # a fixture


def test_saved_maps_are_the_same_maps(folder, tmp_path):
    path, _made = folder
    put(path / "sky.exr", codes(6, 10, 3) * 50)
    put(path / "over.png", np.dstack([codes(6, 10)] * 3 + [codes(6, 10)]))
    chosen = ("albedo", "normal_dx", "gloss", "opacity", "wear mask", "sky", "over")
    texture_set = load_set(path, maps=chosen)
    paths = save_maps(tmp_path / "out", back(texture_set), texture_set.maps)
    assert {each.name for each in paths} == {f"{name}.png" for name in chosen if name != "sky"} | {"sky.exr"}
    again = load_set(tmp_path / "out")
    assert kinds(again) == kinds(texture_set)
    assert {each.name: (each.channels, each.bits) for each in again.maps} == {
        each.name: (each.channels, each.bits) for each in texture_set.maps
    }
    old, new = back(texture_set), back(again)
    for each in texture_set.maps:
        tolerance = 1e-5 * old[each.name].max() if each.kind == "hdr" else 0
        assert np.abs(old[each.name] - new[each.name]).max() <= tolerance, each.name


def test_exr_holds_light(tmp_path):
    texture_set = load_set({"albedo": codes(3, 3, 3), "ao": codes(3, 3)})
    save_maps(tmp_path, back(texture_set), texture_set.maps, exr=True)
    albedo, bits = load_stored(tmp_path / "albedo.exr")
    assert bits == 32 and np.abs(linear_to_srgb(albedo) - back(texture_set)["albedo"]).max() < 1e-6
    assert (load_stored(tmp_path / "ao.exr")[0] == back(texture_set)["ao"]).all()


def test_dds_formats_follow_from_the_kind(tmp_path):
    arrays = {
        "albedo": codes(8, 8, 3),
        "normal": codes(8, 8, 3),
        "rough": codes(8, 8),
        "color": codes(8, 8),
        "decal": codes(8, 8, 4),
        "over": codes(8, 8, 2),
        "sky": codes(8, 8) * 40,
    }
    texture_set = load_set(arrays)
    levels = [to_maps(level, texture_set.maps) for level in mip_chain(texture_set)]
    kinds_of = {each.name: (dds_format(each), dds_format(each, bc1=True)) for each in texture_set.maps}
    assert kinds_of == {
        "albedo": ("bc7", "bc1"),
        "normal": ("bc5", "bc5"),
        "rough": ("bc4", "bc4"),
        "color": ("bc7", "bc1"),  # BC4 is never sRGB
        "decal": ("bc7", "bc3"),
        "over": ("bc7", "bc3"),
        "sky": ("half", "half"),
    }
    numbers = {"albedo": 72, "normal": 83, "rough": 80, "color": 72, "decal": 77, "over": 77, "sky": 54}
    for path in save_blocks(tmp_path, encode_maps(levels, texture_set.maps, bc1=True)):
        file = path.read_bytes()
        assert struct.unpack_from("<I", file, 28) == (4,)  # levels
        assert struct.unpack_from("<I", file, 128) == (numbers.pop(path.stem),)
    assert not numbers
