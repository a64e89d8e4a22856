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
    target: Literal["cpp", "cuda", "vulkan", "glsl", "hlsl", "slang", "wgsl", "msl", "html"]
    """cpp: a C++17 header for the CPU, with a CMake project; cuda: the same for NVIDIA's GPUs, with compiled kernels
    that need the driver alone; vulkan: SPIR-V with a C++ program that runs it; html: a page that shows a picture, a
    sphere or a texture; the others compute shaders"""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """folder for the files"""
    precision: Literal["float32", "tf32", "float16", "bfloat16", "e4m3", "e5m2", "int8"] | None = None
    """of weights and vectors between layers, with sums in float32; that of the network if not given. All but cuda take
    float32 and float16 alone"""
    arch: str | None = None
    """of cuda, architectures of GPUs: 80,90,120 for compute capabilities 8.0, 9.0 and 12.0, which are made if not given
    (newer ones by PTX)"""
    name: str | None = None
    """of the files and the namespace; that of SOURCE if not given"""
    cooperative: bool = False
    """a shader with cooperative vectors beside the plain one: glsl, slang and hlsl, of float16"""
    baked: bool = False
    """of shaders: weights are constants, layers unrolled; for small networks"""
    half: bool = False
    """of shaders of float16: by the device's own numbers, which it must have"""
    force: bool = False
    """replace files that are there"""
    json: bool = False
    """print nothing but one JSON object, as the last line on stdout"""

    def main(self) -> dict:
        from warp_neural.errors import InputError
        from warp_neural.export import export  # reads much that the other commands do without

        words = self.arch.split(",") if self.arch is not None else None
        if words and not all(word.strip().isdecimal() for word in words):
            raise InputError(f"--arch {self.arch}: give numbers such as 80,90,120")
        archs = [int(word) for word in words] if words else None
        options = {"precision": self.precision, "archs": archs, "name": self.name, "force": self.force}
        options |= {"cooperative": self.cooperative, "baked": self.baked, "half": self.half}
        return export(self.source, self.target, self.out, **options)
