"""Folders that a programmer builds without Python: source text, weights, rows to compare with, and a README."""

import re
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from warp_neural import __version__
from warp_neural.errors import InputError
from warp_neural.export import cpp
from warp_neural.export.page import page_files
from warp_neural.export.program import Program, evaluated, make_program
from warp_neural.export.shaders import GROUP, SHADERS
from warp_neural.export.textures import check_target, texture_rows, texture_source, texture_use
from warp_neural.imaging.dds import dds_bytes
from warp_neural.io.files import atomic_path
from warp_neural.nn.mlp import MLP
from warp_neural.nn.network_file import read_state
from warp_neural.nn.state import NetworkState
from warp_neural.texture.block_state import BlockState
from warp_neural.texture.engine_file import engine_state, latent_texture

TARGETS = ("cpp", *SHADERS, "html")
ROWS = 256  # to compare with
RESERVED = set(
    "alignas alignof and asm auto bitand bitor bool break case catch char class compl const constexpr continue default "
    "delete do double else enum explicit export extern false float for friend goto if inline int long main mutable "
    "namespace new noexcept not nullptr operator or private protected public register return short signed sizeof "
    "static std struct switch template this throw true try typedef typeid typename union unsigned using virtual void "
    "volatile while xor".split()
)
"""of C++, for namespaces"""
DIGITS = {"float32": "within 1e-5 of the largest", "float16": "within what rounding to float16 makes of that, 1e-3"}

README = """# {name}

{about}.
{n_in} inputs, {n_out} results, {precision}.

{use}

`inputs.bin` [{rows}, {n_in}] and `outputs.bin` [{rows}, {n_out}], float32, little-endian, are rows to compare with:
{compared}.
"""
USE_CPP = """`{name}.hpp` is all that a program needs: C++17, no dependencies.

```cpp
#include "{name}.hpp"
float x[{name}::inputs] = {{}}, y[{name}::outputs];
{name}::evaluate(x, y);
```

    cmake -B build && cmake --build build && ctest --test-dir build

builds and runs `main.cpp`; so does `g++ -std=c++17 -O3 -march=native -ffp-contract=off main.cpp && ./a.out`."""
USE_SHADER = """`{name}.{suffix}` has a function `evaluate` of one sample, to copy into your shaders, and a compute
entry, `{entry}`, a thread a row in groups of {group}. Buffers: 0 weights (`weights.bin`, float32), 1 inputs, 2
results{count}.

{compile}"""
COMPILE = {
    "glsl": "`glslangValidator -V {name}.comp -o {name}.spv` makes SPIR-V for Vulkan; bindings are of set 0.",
    "hlsl": "`dxc -T cs_6_0 -E main {name}.hlsl -Fo {name}.dxil`; registers are t0, t1 and u2.",
    "slang": "`slangc {name}.slang -target spirv -entry main -stage compute -o {name}.spv`; bindings are of set 0.",
    "wgsl": "WebGPU takes the text as it is; bindings are of group 0.",
    "msl": "`xcrun metal {name}.metal -o {name}.metallib`; buffer 3 is the number of rows, a uint.",
}


def export(
    source: Path | str | MLP | NetworkState,
    target: str,
    directory: Path | str,
    *,
    precision: str | None = None,
    name: str | None = None,
    force: bool = False,
) -> dict[str, Any]:
    """Write a network, or the file of one, for a program without Python; returns the files with their bytes, and the
    hash of the network, which they name too.

    target: one of `TARGETS`. precision: float32, or float16 for weights and vectors between layers, with sums in
    float32; that of the network if None. name: of files, and in C++ of the namespace; that of the source's file if
    None. force: replace what is there.

    Raises `InputError` for what the target cannot express, with what it can, and for files that are there.
    """
    if target not in TARGETS:
        raise InputError(f"target {target!r}: give one of {', '.join(TARGETS)}")
    texture, where = None, "network"
    if isinstance(source, Path | str):
        where, state = Path(source), read_state(source)
        texture = engine_state(where, state) if "texture" in state.extra else None
    else:
        state = source.state if isinstance(source, MLP) else source
    name = identifier(name or Path(where).stem)
    try:
        program = make_program(state, precision, by_inputs=target == "cpp")
        files = _files(program, target, name, texture)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    directory = Path(directory)
    there = [directory / file for file in files if (directory / file).exists()]
    if there and not force:
        raise InputError(f"{there[0]}: is there already; give --force to replace it, or another folder")
    with ExitStack() as stack:  # no file appears before all are written
        for file, data in files.items():
            stack.enter_context(atomic_path(directory / file)).write_bytes(data)
    sizes = {str(directory / file): len(data) for file, data in files.items()}
    return {"target": target, "precision": program.precision, "hash": program.digest, "files": sizes}


def identifier(name: str) -> str:
    """A name that all languages take."""
    name = re.sub(r"\W", "_", name, flags=re.ASCII)
    return name if re.match(r"[A-Za-z]", name) and name not in RESERVED else f"network_{name}"


def _files(program: Program, target: str, name: str, texture: BlockState | None) -> Mapping[str, bytes]:
    spec, encoding = program.state.spec, program.state.encoding
    layers = "-".join(map(str, spec.sizes))
    kind = f"{type(encoding).__name__}, " if encoding else ""
    about = f"Network {program.digest} ({kind}{layers}, {spec.activation.name}) by Warp Neural {__version__}"
    if target == "html":
        return page_files(program, name, about, texture)
    if texture:
        check_target(target)
    inputs, outputs = texture_rows(texture, ROWS) if texture else rows_of(program)
    files = {"inputs.bin": inputs.astype("<f4").tobytes(), "outputs.bin": outputs.astype("<f4").tobytes()}
    if target == "cpp":
        texts, use, compared = _cpp(program, name, about)
    else:
        files["weights.bin"] = program.weights.astype("<f4").tobytes()
        texts, use, compared = _shader(program, target, name, about)
    if texture:
        latents = [f"{name}_latent_{g}.dds" for g in range(len(texture.spec.scales))]
        files |= {file: dds_bytes(latent_texture(texture, g)) for g, file in enumerate(latents)}
        shader = SHADERS[target]()
        texts = {f"{name}.{shader.suffix}": texture_source(target, shader, program, texture, about)}
        use = f"{texture_use(texture, latents)}\n{use}"
        compared = "results are within 2/255, as GPUs filter in fewer bits"
    about = {"name": name, "about": about, "precision": program.precision, "rows": ROWS}
    sizes = {"n_in": inputs.shape[1], "n_out": program.n_out}
    texts["README.md"] = README.format(use=use, compared=compared, **about, **sizes)
    return files | {file: text.encode() for file, text in texts.items()}


def _cpp(program: Program, name: str, about: str) -> tuple[dict[str, str], str, str]:
    """Texts, and what the README says of their use and of the results."""
    texts = {file: (cpp.TEXT / file).read_text().replace("NAME", name) for file in ("main.cpp", "CMakeLists.txt")}
    texts["CMakeLists.txt"] = texts["CMakeLists.txt"].replace(f"add_test({name} compare", "add_test(NAME compare")
    texts[f"{name}.hpp"] = cpp.header(program, name, about)
    return texts, USE_CPP.format(name=name), "results equal these bit for bit"


def _shader(program: Program, target: str, name: str, about: str) -> tuple[dict[str, str], str, str]:
    shader = SHADERS[target]()
    texts = {f"{name}.{shader.suffix}": shader.source(program, about)}
    return texts, use_of(target, name), f"results are {DIGITS[program.precision]}"


def use_of(target: str, name: str) -> str:
    """The part of the README about a shader."""
    entry, count = ("rows", ", 3 their number") if target == "msl" else ("main", ", as many as they hold")
    how = COMPILE[target].format(name=name)
    return USE_SHADER.format(
        name=name, suffix=SHADERS[target].suffix, entry=entry, group=GROUP, count=count, compile=how
    )


def rows_of(program: Program) -> tuple[np.ndarray, np.ndarray]:
    """Inputs from -1 to 1, directions among them of length 1, and what Python makes of them on the CPU."""
    random = np.random.default_rng(0)
    inputs = random.uniform(-1, 1, (ROWS, program.n_in)).astype(np.float32)
    if program.n_in == 3:
        inputs /= np.linalg.norm(inputs, axis=1, keepdims=True)
    return evaluated(program, inputs)
