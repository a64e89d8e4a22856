"""What all pages share: the HTML around a shader, its script, and what is said of it."""

import base64
import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from warp_neural import __version__
from warp_neural.export.gles import TABLE_WIDTH, Gles
from warp_neural.export.program import Program

TEXT = Path(__file__).parent / "text"
VIEW = {"aspect": 1.0, "start": [0.5, 0.5], "lowest": -1e6, "highest": 1e6, "closest": 2000, "farthest": 0.1}
VIEW |= {"pans": True, "latents": []}
"""for the script: width by height of what is shown, (u, v) in its middle, the least and the largest v there; how much
closer and farther one may go; whether what is under the pointer stays there"""
HELP = "Drag or use the arrow keys to move; wheel, pinch, + and &minus; to come closer; 0 to start again."
DEGREES = 'data-digits="0"'


@dataclass(frozen=True)
class Kind:
    """What pages of networks of one kind have beside what all have. main: GLSL after `evaluate`. data: for the script.
    facts: (what, of what size) of the network. about: what is shown, a sentence."""

    main: str
    about: str
    controls: str = ""
    facts: tuple[tuple[str, str], ...] = ()
    data: Mapping[str, Any] = field(default_factory=dict)
    help: str = HELP


def page(program: Program, kind: Kind, name: str, about: str) -> str:
    """The HTML."""
    fragment = Gles().fragment(program, about, (TEXT / "page.frag").read_text() + kind.main)
    data = {**VIEW, "table": table_of(program), **kind.data, "fragment": fragment}
    data["vertex"] = (TEXT / "page.vert").read_text()
    facts = (("This page", "@BYTES@ bytes"), *kind.facts)
    values = {
        "VERSION": __version__,
        "TITLE": html.escape(name.replace("_", " ")),
        "ABOUT": f"{html.escape(kind.about)} {html.escape(about)}.",
        "LABEL": html.escape(f"{name}: {kind.about}"),
        "ASPECT": f"{data['aspect']:.6g}",
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


def slider(name: str, label: str, low: float, high: float, step: float, value: float, more: str = "") -> str:
    """A row of controls; what it says is a uniform of the shader."""
    numbers = f'min="{low}" max="{high}" step="{step}" value="{value}"'
    return row(
        f'<label for="{name}">{label}</label><output for="{name}"></output>'
        f'<input type="range" id="{name}" data-uniform="{name}" {numbers} {more}>'.replace(" >", ">")
    )


def light_sliders(azimuth: float, elevation: float, lowest: int = 5) -> str:
    """Degrees: where it is, counterclockwise from the right of the screen, and how far out of that."""
    where = slider("azimuth", "Light from", -180, 180, 1, azimuth, DEGREES)
    return where + slider("elevation", "Height of the light", lowest, 90, 1, elevation, DEGREES)


def switch(name: str, label: str, on: bool) -> str:
    return row(
        f'<label for="{name}">{label}</label>'
        f'<input type="checkbox" id="{name}" data-uniform="{name}"{" checked" if on else ""}>'
    )


def color(name: str, label: str, value: str) -> str:
    """value: as #rrggbb."""
    control = f'<input type="color" id="{name}" data-uniform="{name}" value="{value}">'
    return row(f'<label for="{name}">{label}</label>{control}')


def choice(name: str, label: str, options: Sequence[str]) -> str:
    """The uniform is the number of what is chosen."""
    listed = "".join(f'<option value="{i}">{html.escape(option)}</option>' for i, option in enumerate(options))
    return row(f'<label for="{name}">{label}</label><select id="{name}" data-uniform="{name}">{listed}</select>')


def row(content: str) -> str:
    return f"<div>{content}</div>\n"
