"""One HTML file that shows a network in a browser: WebGL2, no server, no request; `target` html."""

import base64
import html
import io
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from warp_neural import __version__
from warp_neural.errors import InputError
from warp_neural.export.gles import TABLE_WIDTH, Gles
from warp_neural.export.program import Program
from warp_neural.imaging.image import linear_to_srgb
from warp_neural.nn.mlp import MLP
from warp_neural.texture.block_state import BlockState

TEXT = Path(__file__).parent / "text"
WIDEST = 128  # neurons of a layer: its weights are text, 0.2 MB where two layers have as many
PNG_SIDE = 256
HELP = "Drag or use the arrow keys to move; wheel, pinch, + and &minus; to come closer; 0 to start again."
README = """# {name}

{about}.

`{name}.html` is all: open it in a browser with WebGL2, from the disk too. It asks for nothing over the network. The
weights are constants of its fragment shader, {precision}; it computes in float32. {shows}
"""


@dataclass(frozen=True)
class Kind:
    """What pages of networks of one kind have beside what all have. main: GLSL after `evaluate`. data: for the script.
    facts: (what, of what size) of the network. about: what is shown, a sentence."""

    main: str
    about: str
    controls: str
    facts: tuple[tuple[str, str], ...] = ()
    data: Mapping[str, Any] | None = None
    help: str = HELP


def page_files(program: Program, name: str, about: str, texture: BlockState | None) -> dict[str, bytes]:
    """The page and the README. Raises `InputError` for networks that pages cannot show."""
    program = replace(program, unrolled=True)
    kind = kind_of(program, texture)
    widest = max(program.state.spec.sizes)
    if widest > WIDEST:
        raise InputError(f"a layer of {widest}: pages have layers of up to {WIDEST}, as constants; give target wgsl")
    readme = README.format(name=name, about=about, precision=program.precision, shows=kind.about)
    return {f"{name}.html": page(program, kind, name, about).encode(), "README.md": readme.encode()}


def kind_of(program: Program, texture: BlockState | None) -> Kind:
    if texture:
        from warp_neural.export.page_texture import texture_kind

        return texture_kind(program, texture)
    if (program.n_in, program.n_out) == (2, 3):
        facts = (*network_facts(program), (f"As a PNG of {PNG_SIDE} x {PNG_SIDE}", f"{png_size(program):,} bytes"))
        return Kind((TEXT / "picture.frag").read_text(), PICTURE, "", facts)
    raise InputError(
        f"{program.n_in} inputs and {program.n_out} results: pages show pictures, 2 inputs (u, v) and 3 results (linear "
        "RGB), and textures for engines; give target wgsl for others"
    )


def png_size(program: Program) -> int:
    """Bytes of the picture by Python."""
    v, u = np.meshgrid(*2 * ((np.arange(PNG_SIDE) + 0.5) / PNG_SIDE,), indexing="ij")
    net = MLP.from_state(program.state, device="cpu")
    linear = net.evaluate(np.stack([u, v], -1).reshape(-1, 2).astype(np.float32)).numpy()
    codes = np.rint(255 * linear_to_srgb(np.clip(np.float32(linear), 0, 1))).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(codes.reshape(PNG_SIDE, PNG_SIDE, 3)).save(file, "png", optimize=True)
    return file.tell()


PICTURE = "The network is asked for a colour, linear RGB, at (u, v) of every pixel; it is shown as sRGB."


def page(program: Program, kind: Kind, name: str, about: str) -> str:
    main = (TEXT / "page.frag").read_text() + kind.main
    data = {
        "vertex": (TEXT / "page.vert").read_text(),
        "fragment": Gles().fragment(program, about, main),
        **{"aspect": 1.0, "start": [0.5, 0.5], "extent": 1.0, "lowest": -1e6, "highest": 1e6, "pans": True},
        **{"closest": 2000, "farthest": 0.1, "latents": [], "table": table_of(program), **(kind.data or {})},
    }
    facts = (("This page", "@BYTES@ bytes"), *kind.facts)
    values = {
        "VERSION": __version__,
        "TITLE": html.escape(name.replace("_", " ")),
        "ABOUT": f"{html.escape(kind.about)} {html.escape(about)}.",
        "LABEL": html.escape(f"{name}: {kind.about}"),
        "ASPECT": f"{data['aspect']:.6g}",
        "CURSOR": "grab",
        "CONTROLS": kind.controls,
        "FACTS": "\n".join(f"<dt>{html.escape(what)}</dt><dd>{html.escape(size)}</dd>" for what, size in facts),
        "HELP": kind.help,
        "DATA": json.dumps(data, separators=(",", ":")).replace("<", "\\u003c"),
        "SCRIPT": (TEXT / "textures.js").read_text() + (TEXT / "page.js").read_text(),
    }
    text = (TEXT / "page.html").read_text()
    return with_size(re.sub("@([A-Z]+)@", lambda key: values[key[1]], text))


def with_size(text: str) -> str:
    """`text` with its own size in bytes in place of @BYTES@."""
    size = 0
    while size != (size := len(text.replace("@BYTES@", f"{size:,}").encode())):
        pass
    return text.replace("@BYTES@", f"{size:,}")


def network_facts(program: Program) -> tuple[tuple[str, str], ...]:
    state = program.state
    count = state.parameters.size + state.encoding_parameters.size
    size = count * (2 if program.precision == "float16" else 4)
    return ((f"The network, {count:,} numbers of {program.precision}", f"{size:,} bytes"),)


def table_of(program: Program) -> dict[str, Any] | None:
    """Parameters of the encoding as a texture of floats."""
    if not program.weights.size:
        return None
    values = np.pad(program.weights, (0, -program.weights.size % TABLE_WIDTH)).astype("<f4")
    return {"width": TABLE_WIDTH, "values": coded(values.tobytes())}


def coded(data: bytes) -> str:
    return base64.b64encode(data).decode()
