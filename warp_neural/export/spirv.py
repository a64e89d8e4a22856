"""SPIR-V by the compilers that are here: glslangValidator, or slangc."""

import os
import re
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from warp_neural.errors import InputError
from warp_neural.export.cooperative import CooperativeGlsl, CooperativeSlang
from warp_neural.export.program import Program
from warp_neural.export.shaders import Glsl, Shader, Slang

REMEDY = """install glslangValidator (Debian's glslang-tools, the Vulkan SDK{newer}), or slangc: \
pip install --no-deps slangtorch"""
COOPERATIVE = 15  # glslang's first version with cooperative vectors


def slangc() -> Path | None:
    """On the path, or in the package slangtorch, which is not imported: that would need PyTorch."""
    if found := shutil.which("slangc"):
        return Path(found)
    if not (spec := find_spec("slangtorch")):
        return None
    compiler = Path(spec.origin).parent / "bin" / "slangc"
    if not os.access(compiler, os.X_OK):
        compiler.chmod(0o755)  # pip forgets it
    return compiler


def glslang() -> int:
    """Of glslangValidator on the path the major version, 0 if there is none."""
    if not shutil.which("glslangValidator"):
        return 0
    said = subprocess.run(["glslangValidator", "--version"], capture_output=True, text=True).stdout
    found = re.search(r"Glslang Version: \d+:(\d+)", said)
    return int(found[1]) if found else 1


def missing(precision: str) -> str | None:
    """What it takes to make SPIR-V and is not here."""
    newer = precision == "float16"
    if glslang() >= (COOPERATIVE if newer else 1) or slangc():
        return None
    return f"glslangValidator{f' {COOPERATIVE} or newer' if newer else ''} or slangc"


def plain(program: Program, about: str) -> bytes:
    """By glslangValidator if it is there: drivers hang on what slangc gives without its optimizer, Mesa's for one."""
    if not glslang():
        return _by_slangc(Slang().source(program, about), REMEDY.format(newer=""))
    return _by_glslang(Glsl(), program, about, "vulkan1.1")


def cooperative(program: Program, about: str) -> bytes:
    if glslang() >= COOPERATIVE:
        return _by_glslang(CooperativeGlsl(), program, about, "vulkan1.2")
    remedy = f"float16 has cooperative vectors: {REMEDY.format(newer=f'; {COOPERATIVE} or newer')}, or take float32"
    return _by_slangc(CooperativeSlang().source(program, about), remedy)


def _by_glslang(shader: Shader, program: Program, about: str, environment: str) -> bytes:
    options = ["--target-env", environment, "-V"]
    return _compiled(["glslangValidator", *options], shader.source(program, about), "network.comp", dict(os.environ))


def _by_slangc(source: str, remedy: str) -> bytes:
    """remedy: if it is not here."""
    compiler = slangc()
    if not compiler:
        raise InputError(f"target vulkan makes SPIR-V, {remedy}")
    environment = {**os.environ, "LD_LIBRARY_PATH": str(compiler.parent)}
    options = ["-target", "spirv", "-O0", "-entry", "main", "-stage", "compute"]  # -O0: slangtorch has no optimizer
    return _compiled([str(compiler), *options], source, "network.slang", environment)


def _compiled(command: list[str], source: str, name: str, environment: dict[str, str]) -> bytes:
    with TemporaryDirectory() as folder:
        path, result = Path(folder) / name, Path(folder) / "network.spv"
        path.write_text(source)
        done = subprocess.run(
            [*command, name, "-o", result.name], cwd=folder, env=environment, capture_output=True, text=True
        )
        if done.returncode:
            said = [line.strip() for line in (done.stdout + done.stderr).splitlines() if "error" in line.lower()]
            raise InputError(f"{Path(command[0]).name} refuses the shader: {said[0] if said else done.returncode}")
        return result.read_bytes()
