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
from warp_neural.export.shader_folder import Forms, shader_files
from warp_neural.export.shaders import SHADERS
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
    baked: bool = False,
    half: bool = False,
) -> dict[str, Any]:
    """Write a network, or the file of one, for a program without Python; returns the files with their bytes, and the
    hash of the network, which they name too.

    target: one of `TARGETS`. precision: float32, or float16 for weights and vectors between layers, with sums in
    float32 (cuda: any); that of the network if None. archs: of cuda, 90 for compute capability 9.0. name: of files, and
    in C++ of the namespace; that of the source's file if None. force: replace what is there.

    Of shaders: cooperative: one with cooperative vectors beside the plain one, of GLSL, Slang and HLSL, for precision
    float16. baked: weights are constants, layers unrolled, vectors between them float32; for small networks. half:
    float16 by the device's own numbers, which it must have, not by their bits: faster, but drivers may leave out what
    rounds, and infinities.

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
        forms = Forms(cooperative, baked, half)
        check_options(target, archs, forms, texture)
        if target == "cuda":
            precision, digest, files = _cuda(state, precision, name, archs or ARCHS)
        else:
            program = make_program(state, precision, by_inputs=target == "cpp", unrolled=baked or target == "html")
            precision, digest = program.precision, program.digest
            files = _files(program, target, name, texture, forms)
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


def check_options(target: str, archs: Sequence[int] | None, forms: Forms, texture: BlockState | None) -> None:
    """Raises `InputError` for options of other targets."""
    if archs is not None and target != "cuda":
        raise InputError(f"archs {archs}: target cuda alone has them")
    for name in ("baked", "half"):
        if getattr(forms, name) and target not in SHADERS:
            raise InputError(f"{name}: not for {target}; give one of {', '.join(SHADERS)}")
    if forms.cooperative:
        vectors.check_target(target, texture is not None)
    if texture:
        check_target(target)


def _files(program: Program, target: str, name: str, texture: BlockState | None, forms: Forms) -> dict[str, bytes]:
    about = about_of(program.state, program.digest)
    if target == "html":
        return page_files(program, name, about, texture)
    inputs, outputs = texture_rows(texture, ROWS) if texture else rows_of(network_of(program.state, program.precision))
    if target == "cpp":
        files, use, compared = _cpp(program, name, about)
    elif target == "vulkan":
        files, use, compared = vulkan.project(program, name, about)
    else:
        files, use, compared = shader_files(program, target, name, about, forms.half)
    if forms.cooperative:
        more, also = vectors.additions(program, target, name, about)
        files, use = files | more, use + also
    if texture:
        latents = [f"{name}_latent_{g}.dds" for g in range(len(texture.spec.scales))]
        files |= {file: dds_bytes(latent_texture(texture, g)) for g, file in enumerate(latents)}
        shader = SHADERS[target](forms.half)
        files[f"{name}.{shader.suffix}"] = texture_source(target, shader, program, texture, about).encode()
        use = f"{texture_use(texture, latents)}\n{use}"
        compared = "results are within 2/255, as GPUs filter in fewer bits"
    about = {"name": name, "about": about, "precision": program.precision}
    return files | with_rows(inputs, outputs, use=use, compared=compared, **about)


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


def _cpp(program: Program, name: str, about: str) -> tuple[dict[str, bytes], str, str]:
    """Files, and what the README says of their use and of the results."""
    files = {file: cpp.named((cpp.TEXT / file).read_text(), name).encode() for file in ("main.cpp", "CMakeLists.txt")}
    files[f"{name}.hpp"] = cpp.header(program, name, about).encode()
    return files, USE_CPP.format(name=name), "results equal these bit for bit"


def rows_of(net: MLP) -> tuple[np.ndarray, np.ndarray]:
    """Inputs from -1 to 1, directions among them of length 1, and what Python makes of them."""
    random = np.random.default_rng(0)
    inputs = random.uniform(-1, 1, (ROWS, net.n_in)).astype(np.float32)
    if net.n_in == 3:
        inputs /= np.linalg.norm(inputs, axis=1, keepdims=True)
    return evaluated(net, inputs)
