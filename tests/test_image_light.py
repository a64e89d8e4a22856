"""Radiance HDR of every kind of scanline and header, primaries of HDR and EXR, and what is no file at all."""

import itertools
import os

import numpy as np
import OpenEXR
import pytest
from image_picture import refused

from warp_neural.errors import InputError
from warp_neural.imaging.image import load_exr, load_exr_mips, load_image

HEIGHT, WIDTH = 6, 600
RNG = np.random.default_rng(0)
RGBE = RNG.integers(2, 256, (HEIGHT, WIDTH, 4)).astype(np.uint8)
RGBE[..., 3] = RNG.integers(120, 136, (HEIGHT, WIDTH))
RGBE[:, 4:540] = RGBE[:, 4:5]  # a run that takes two counts
RADIANCE = np.ldexp(RGBE[..., :3].astype(np.float32), RGBE[..., 3:].astype(np.int32) - 136)

ACES = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
ACES_TO_REC_709 = [[2.52169, -1.13413, -0.38756], [-0.27648, 1.37272, -0.09624], [-0.01538, -0.15298, 1.16835]]
"""AP0 to Rec. 709 with Bradford's adaptation, as OpenColorIO's ACES configurations have it."""


def flat(row):
    return row.tobytes()


def old(row):
    """Runs of before 1991: a pixel, then 1 1 1 n for n more of it, then 1 1 1 m for 256 m more."""
    out = b""
    for pixel, group in itertools.groupby(row.tolist()):
        more = len(list(group)) - 1
        out += bytes(pixel) + (bytes((1, 1, 1, more & 255)) if more else b"")
        out += bytes((1, 1, 1, more >> 8)) if more > 255 else b""
    return out


def new(row):
    """Each channel for itself, here as literals of at most 128 bytes."""
    out = bytes((2, 2, len(row) >> 8, len(row) & 255))
    for channel, start in itertools.product(range(4), range(0, len(row), 128)):
        piece = row[start : start + 128, channel]
        out += bytes((len(piece),)) + piece.tobytes()
    return out


def hdr(scanlines, header=b"FORMAT=32-bit_rle_rgbe", size=b"-Y 6 +X 600", end=b"\n"):
    lines = [b"#?RADIANCE", *header.split(b"\n"), b"", size]
    return b"".join(line + end for line in lines) + b"".join(scanlines)


@pytest.mark.parametrize("kinds", list(itertools.permutations((flat, old, new))))
def test_each_scanline_by_its_own_start(tmp_path, kinds):
    scanlines = [kind(row) for kind, row in zip(itertools.cycle(kinds), RGBE, strict=False)]
    (tmp_path / "a.hdr").write_bytes(hdr(scanlines))
    assert np.array_equal(load_image(tmp_path / "a.hdr"), RADIANCE)


@pytest.mark.parametrize("kind", [flat, old, new])
def test_scanlines_of_one_kind_and_headers_of_windows(tmp_path, kind):
    for end in (b"\n", b"\r\n"):
        (tmp_path / "a.hdr").write_bytes(hdr(map(kind, RGBE), end=end))
        assert np.array_equal(load_image(tmp_path / "a.hdr"), RADIANCE)
    cut = hdr(map(kind, RGBE))[:-3]
    refused(tmp_path / "a.hdr", cut, "cut short or damaged")


@pytest.mark.parametrize("signs", list(itertools.product("-+", "+-")))
def test_flipped_and_turned(tmp_path, signs):
    y, x = signs
    stored = RGBE[:: 1 if y == "-" else -1, :: 1 if x == "+" else -1]
    (tmp_path / "a.hdr").write_bytes(hdr(map(new, stored), size=f"{y}Y 6 {x}X 600".encode()))
    assert np.array_equal(load_image(tmp_path / "a.hdr"), RADIANCE)
    columns = [flat(column) for column in stored.swapaxes(0, 1)]
    (tmp_path / "a.hdr").write_bytes(hdr(columns, size=f"{x}X 600 {y}Y 6".encode()))
    assert np.array_equal(load_image(tmp_path / "a.hdr"), RADIANCE)


def test_exposure_is_taken_out(tmp_path):
    """Ward, "Picture File Format": radiances are the values divided by all the exposures multiplied together."""
    header = b"FORMAT=32-bit_rle_rgbe\nEXPOSURE=2\nEXPOSURE= 4.0\nCOLORCORR=1 0.5 2"
    (tmp_path / "a.hdr").write_bytes(hdr(map(new, RGBE), header))
    assert np.array_equal(load_image(tmp_path / "a.hdr"), RADIANCE / np.float32([8, 4, 16]))


def test_primaries_are_converted_unless_they_are_data(tmp_path):
    expected = RADIANCE @ np.array(ACES_TO_REC_709).T
    header = b"FORMAT=32-bit_rle_rgbe\nPRIMARIES=" + " ".join(map(str, ACES)).encode()
    (tmp_path / "a.hdr").write_bytes(hdr(map(new, RGBE), header))
    channels = {name: RADIANCE[..., k].copy() for k, name in enumerate("RGB")}
    about = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File({**about, "chromaticities": ACES}, channels).write(str(tmp_path / "a.exr"))
    for name in ("a.hdr", "a.exr"):
        assert np.allclose(load_image(tmp_path / name), expected, atol=2e-5 * RADIANCE.max())
        assert np.array_equal(load_image(tmp_path / name, color_space="linear"), RADIANCE)
    OpenEXR.File({**about, "chromaticities": (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)}, channels).write(
        str(tmp_path / "b.exr")
    )
    assert np.array_equal(load_image(tmp_path / "b.exr"), RADIANCE)
    OpenEXR.File({**about, "chromaticities": (0.3, 0.3) * 4}, channels).write(str(tmp_path / "c.exr"))
    with pytest.raises(InputError, match=r"c\.exr: its primaries.*no colours"):
        load_image(tmp_path / "c.exr")
    (tmp_path / "d.hdr").write_bytes(hdr(map(new, RGBE), b"PRIMARIES=0 0 0 0 0 0 0 0"))  # as Photoshop writes
    assert np.array_equal(load_image(tmp_path / "d.hdr"), RADIANCE)


def test_grey_exr_with_alpha_is_straight(tmp_path):
    grey, alpha = RADIANCE[..., 0] + 1, np.full((HEIGHT, WIDTH), 0.5, np.float32)
    about = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(about, {"Y": grey * alpha, "A": alpha}).write(str(tmp_path / "a.exr"))
    read = load_image(tmp_path / "a.exr")
    assert np.array_equal(read, np.stack([grey, grey, grey, alpha], axis=-1))


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".hdr", ".exr"])
@pytest.mark.parametrize("load", [load_image, load_exr, load_exr_mips])
def test_what_is_no_file(tmp_path, suffix, load):
    """Pipes and devices are never opened: reading them would wait, or not end."""
    os.mkfifo(tmp_path / f"pipe{suffix}")
    (tmp_path / f"zero{suffix}").symlink_to("/dev/zero")
    (tmp_path / f"folder{suffix}").mkdir()
    (tmp_path / f"empty{suffix}").write_bytes(b"")
    with open(tmp_path / f"huge{suffix}", "wb") as file:
        file.truncate(2**40)  # takes no room
    for name, words in {
        "pipe": "pipe or device",
        "zero": "pipe or device",
        "folder": "folder",
        "empty": "no known image|cannot be read",
        "huge": "1099511627776 bytes",
        "nul\0": "cannot be read",
        "none": "cannot be read",
    }.items():
        with pytest.raises(InputError, match=words) as caught:
            load(tmp_path / f"{name}{suffix}")
        assert "\n" not in str(caught.value)


def test_names_that_the_library_would_take_apart(tmp_path):
    for name in ("what?a=1.hdr", "50% #1 %04d.hdr", "é\udcff.hdr"):
        (tmp_path / name).write_bytes(hdr(map(new, RGBE)))
        assert np.array_equal(load_image(tmp_path / name), RADIANCE)
