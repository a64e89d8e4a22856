"""Pages of networks that are pictures: (u, v) to linear RGB."""

import io

import numpy as np
from PIL import Image

from warp_neural.export.page_parts import TEXT, Kind, network_facts
from warp_neural.export.program import Program, evaluated, network_of
from warp_neural.imaging.image import linear_to_srgb

ABOUT = "The network is asked for a colour, linear RGB, at (u, v) of every pixel; it is shown as sRGB."
PNG_SIDE = 256


def picture_kind(program: Program) -> Kind:
    facts = (*network_facts(program), (f"As a PNG of {PNG_SIDE} x {PNG_SIDE}", f"{png_size(program):,} bytes"))
    return Kind((TEXT / "picture.frag").read_text(), ABOUT, facts=facts)


def png_size(program: Program) -> int:
    """Bytes of the picture, by Python."""
    centres = (np.arange(PNG_SIDE, dtype=np.float32) + 0.5) / PNG_SIDE
    v, u = np.meshgrid(centres, centres, indexing="ij")
    _inputs, linear = evaluated(network_of(program.state, program.precision), np.stack([u, v], -1).reshape(-1, 2))
    codes = np.rint(255 * linear_to_srgb(np.clip(linear, 0, 1))).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(codes.reshape(PNG_SIDE, PNG_SIDE, 3)).save(file, "png", optimize=True)
    return file.tell()
