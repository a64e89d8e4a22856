"""Folders that a programmer builds without Python: source text, weights, rows to compare with, and a README."""

import re
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from warp_neural import __version__
from warp_neural.errors import InputError
from warp_neural.export import cooperative as vectors
from warp_neural.export import cpp, vulkan
from warp_neural.export.cuda import ARCHS, cuda_files
from warp_neural.export.page import page_files
from warp_neural.export.program import Program, check_finite, digest_of, evaluated, make_program, network_of
from warp_neural.export.shaders import GROUP, SHADERS
from warp_neural.export.textures import check_target, texture_rows, texture_source, texture_use
from warp_neural.imaging.dds import dds_bytes
from warp_neural.io.files import atomic_path
from warp_neural.nn.mlp import MLP
from warp_neural.nn.network_file import read_state
from warp_neural.nn.state import NetworkState
from warp_neural.texture.block_state import BlockState
from warp_neural.texture.engine_file import engine_state, latent_texture

TARGETS = ("cpp", "cuda", "vulkan", *SHADERS, "html")
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
    archs: Sequence[int] | None = None,
    name: str | None = None,
    force: bool = False,
    cooperative: bool = False,
) -> dict[str, Any]:
    """Write a network, or the file of one, for a program without Python; returns the files with their bytes, and the
    hash of the network, which they name too.

    target: one of `TARGETS`. precision: float32, or float16 for weights and vectors between layers, with sums in
    float32 (cuda: any); that of the network if None. archs: of cuda, 90 for compute capability 9.0. name: of files, and
    in C++ of the namespace; that of the source's file if None. force: replace what is there. cooperative: a shader with
    cooperative vectors beside the plain one, of GLSL, Slang and HLSL, for precision float16.

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
        check_options(target, archs, cooperative, texture)
        if target == "cuda":
            precision, digest, files = _cuda(state, precision, name, archs or ARCHS)
        else:
            program = make_program(state, precision, by_inputs=target == "cpp")
            precision, digest = program.precision, program.digest
            files = _files(program, target, name, texture, cooperative)
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
    return {"target": target, "precision": precision, "hash": digest, "files": sizes}


def identifier(name: str) -> str:
    """A name that all languages take."""
    name = re.sub(r"\W", "_", name, flags=re.ASCII)
    return name if re.match(r"[A-Za-z]", name) and name not in RESERVED else f"network_{name}"


def check_options(target: str, archs: Sequence[int] | None, cooperative: bool, texture: BlockState | None) -> None:
    """Raises `InputError` for options of other targets."""
    if archs is not None and target != "cuda":
        raise InputError(f"archs {archs}: target cuda alone has them")
    if cooperative:
        vectors.check_target(target, texture is not None)
    if texture:
        check_target(target)


def _files(program: Program, target: str, name: str, texture: BlockState | None, cooperative: bool) -> dict[str, bytes]:
    about = about_of(program.state, program.digest)
    if target == "html":
        return page_files(program, name, about, texture)
    inputs, outputs = texture_rows(texture, ROWS) if texture else rows_of(network_of(program.state, program.precision))
    files = {}
    if target == "cpp":
        texts, use, compared = _cpp(program, name, about)
    elif target == "vulkan":
        made, use, compared = vulkan.project(program, name, about)
        files, texts = files | made, {}
    else:
        files["weights.bin"] = program.weights.astype("<f4").tobytes()
        texts, use, compared = _shader(program, target, name, about)
    if cooperative:
        more, also = vectors.additions(program, target, name, about)
        files, use = files | more, use + also
    if texture:
        latents = [f"{name}_latent_{g}.dds" for g in range(len(texture.spec.scales))]
        files |= {file: dds_bytes(latent_texture(texture, g)) for g, file in enumerate(latents)}
        shader = SHADERS[target]()
        texts = {f"{name}.{shader.suffix}": texture_source(target, shader, program, texture, about)}
        use = f"{texture_use(texture, latents)}\n{use}"
        compared = "results are within 2/255, as GPUs filter in fewer bits"
    rows = with_rows(inputs, outputs, name=name, about=about, precision=program.precision, use=use, compared=compared)
    return files | {file: text.encode() for file, text in texts.items()} | rows


def _cuda(
    state: NetworkState, precision: str | None, name: str, archs: Sequence[int]
) -> tuple[str, str, dict[str, bytes]]:
    """Precision, hash and files."""
    check_finite(state)
    net = network_of(state, precision)
    precision, digest = net.precision, digest_of(state, net.precision)
    about = about_of(state, digest)
    files, use = cuda_files(net, name, about, digest, archs)
    compared = "the program says how far results are off, and how far another device's rounding explains"
    kind = {"name": name, "about": about, "precision": precision, "use": use, "compared": compared}
    return precision, digest, files | with_rows(*rows_of(net), **kind)


def about_of(state: NetworkState, digest: str) -> str:
    layers, encoding = "-".join(map(str, state.spec.sizes)), state.encoding
    kind = f"{type(encoding).__name__}, " if encoding else ""
    return f"Network {digest} ({kind}{layers}, {state.spec.activation.name}) by Warp Neural {__version__}"


def with_rows(inputs: np.ndarray, outputs: np.ndarray, **about: str) -> dict[str, bytes]:
    """Rows to compare with, and the README, which tells of them and `about` the rest."""
    readme = README.format(rows=len(inputs), n_in=inputs.shape[1], n_out=outputs.shape[1], **about)
    files = {"inputs.bin": inputs.astype("<f4").tobytes(), "outputs.bin": outputs.astype("<f4").tobytes()}
    return files | {"README.md": readme.encode()}


def _cpp(program: Program, name: str, about: str) -> tuple[dict[str, str], str, str]:
    """Texts, and what the README says of their use and of the results."""
    texts = {file: cpp.named((cpp.TEXT / file).read_text(), name) for file in ("main.cpp", "CMakeLists.txt")}
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


def rows_of(net: MLP) -> tuple[np.ndarray, np.ndarray]:
    """Inputs from -1 to 1, directions among them of length 1, and what Python makes of them."""
    random = np.random.default_rng(0)
    inputs = random.uniform(-1, 1, (ROWS, net.n_in)).astype(np.float32)
    if net.n_in == 3:
        inputs /= np.linalg.norm(inputs, axis=1, keepdims=True)
    return evaluated(net, inputs)
