"""`warp-neural export`: a network's source text for programs without Python."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write a network as source text, with its weights and rows to compare with, for a program without Python.

    Folders have a README for whoever builds them, and name the version and the network's hash.
    """

    source: tyro.conf.Positional[Path]
    """.safetensors of a network"""
    target: Literal["cpp", "glsl", "hlsl", "slang", "wgsl", "msl", "html"]
    """cpp: a C++17 header for the CPU, with a CMake project; html: a page that shows a picture, a sphere or a texture;
    the others compute shaders"""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """folder for the files"""
    precision: Literal["float32", "float16"] | None = None
    """float16 of weights and vectors between layers, sums in float32; that of the network if not given"""
    name: str | None = None
    """of the files and the namespace; that of SOURCE if not given"""
    force: bool = False
    """replace files that are there"""
    json: bool = False
    """print nothing but one JSON object, as the last line on stdout"""

    def main(self) -> dict:
        from warp_neural.export import export  # reads much that the other commands do without

        options = {"precision": self.precision, "name": self.name, "force": self.force}
        return export(self.source, self.target, self.out, **options)
