"""C++ on CUDA: the kernels of `MLP.evaluate` as cubins, tensor cores included, and a host that needs but the driver."""

import ctypes
import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.export.cpp import named
from warp_neural.kernels.coopvec.cuda.warpgroup_rows import RowsSchedule, make_rows_schedule
from warp_neural.kernels.coopvec.layout import bias_is_half, layer_table, make_pack_kernel, network_layout
from warp_neural.kernels.coopvec.rows import BLOCK, make_evaluate_kernel, make_warpgroup_kernel
from warp_neural.kernels.coopvec.typed import kind_of
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters
from warp_neural.kernels.training.schedule import HOPPER_BYTES
from warp_neural.nn.loading import ARCH
from warp_neural.nn.mlp import MLP

TEXT = Path(__file__).parent / "text" / "cuda"
ARCHS = 80, 90, 120
HOPPER = 90
ROUNDING = {
    "float32": 2e-6,
    "tf32": 2**-11,
    "float16": 2**-11,
    "bfloat16": 2**-8,
    "e4m3": 2**-4,
    "e5m2": 2**-3,
    "int8": 2**-6,
}
"""relative, of one number"""
USE = """`{name}.hpp` has a class, `{name}::Network`, of rows in the memory of a CUDA device; it and `driver.hpp`
need C++17 and nothing of CUDA. To run, a program needs NVIDIA's driver (of CUDA 13, 580 or newer) and this folder:

```cpp
#include "{name}.hpp"
const cuda::Driver driver;                   // throws cuda::Unavailable where there is none
const {name}::Network network(driver, "folder");
network.evaluate(x, y, rows);                // pointers to device memory, rows of {element}
```

    cmake -B build && cmake --build build && ctest --test-dir build

builds and runs `main.cpp`, which compares, measures{picture}; so does
`g++ -std=c++17 -O2 main.cpp -ldl && ./a.out`. Its exit code is 77 where no device is that these kernels run on.

Kernels are for compute capability {archs}, and by PTX for newer ones.
`weights.bin` is float32: of each layer weights [outputs, inputs], row major, and biases, then what the encoding has;
`Network` converts them on the device to the layout that its kernels read."""


@dataclass(frozen=True)
class Binary:
    """A compiled kernel: `kind` and `file` as network.hpp has them, `function` its symbol in it."""

    kind: str
    arch: int
    file: str
    function: str
    code: bytes

    @property
    def row(self) -> str:
        ptx = str(self.file.endswith(".ptx")).lower()
        return f'    {{Kind::{self.kind}, {self.arch}, {ptx}, "{self.file}", "{self.function}"}},\n'


def cuda_files(net: MLP, name: str, about: str, digest: str, archs: Sequence[int]) -> tuple[dict[str, bytes], str]:
    """Of a network on the CPU; and what the README says of their use."""
    check_archs(archs)
    schedule = make_rows_schedule(net.spec, HOPPER, HOPPER_BYTES) if HOPPER in archs and evaluates_rows(net) else None
    binaries = compile_all(net, sorted(set(archs)), schedule)
    values = constants(net, schedule) | {"ABOUT": about, "HASH": digest, "BINARIES": "".join(b.row for b in binaries)}
    files = {file: (TEXT / file).read_text() for file in ("main.cpp", "driver.hpp", "CMakeLists.txt")}
    files[f"{name}.hpp"] = fill((TEXT / "network.hpp").read_text(), values)
    files = {file: named(text, name).encode() for file, text in files.items()}
    weights = np.concatenate([net.master.numpy(), net.steps.numpy().ravel()]).astype("<f4")
    use = USE.format(
        name=name,
        element=net.spec.dtype.__name__,
        picture=" and writes a picture" if (net.n_in, net.spec.sizes[-1]) == (2, 3) else "",
        archs=", ".join(f"{arch // 10}.{arch % 10}" for arch in sorted(set(archs))),
    )
    return files | {b.file: b.code for b in binaries} | {"weights.bin": weights.tobytes()}, use


def evaluates_rows(net: MLP) -> bool:
    """Whether warpgroups may: no encoding, on tensor cores."""
    return net.encoding is None and net.implementation == "cooperative"


def check_archs(archs: Sequence[int]) -> None:
    known = wp.get_cuda_supported_archs()
    if not known:
        raise InputError("this build of Warp has no CUDA compiler; export on Linux or Windows")
    for arch in archs or [None]:
        if arch not in known:
            raise InputError(f"--arch {arch}: give some of {', '.join(map(str, known))}")


def compile_all(net: MLP, archs: list[int], schedule: RowsSchedule | None) -> list[Binary]:
    """Cubins for each architecture, PTX of the oldest for those that are not among them."""
    kernels = {
        "pack": (make_pack_kernel(net.spec.format, True, bias_is_half(net.spec, True)), 256),
        "rows": (make_evaluate_kernel(net.plain_of_row, net.vec_out), BLOCK),
    }
    binaries = []
    for kind, (kernel, threads) in kernels.items():
        binaries += [compiled(kind, kernel, threads, arch) for arch in archs]
        binaries.append(compiled(kind, kernel, threads, archs[0], ptx=True))
    if schedule:
        binaries.append(compiled("groups", make_warpgroup_kernel(net.spec, schedule), schedule.threads, HOPPER, "a"))
    return binaries


def compiled(kind: str, kernel: wp.Kernel, threads: int, arch: int, suffix: str = "", ptx: bool = False) -> Binary:
    module, before = kernel.module, kernel.module.options["block_dim"]
    with ARCH, TemporaryDirectory() as folder:
        suffix_before = wp.config.cuda_arch_suffix
        try:
            wp.config.cuda_arch_suffix = suffix or None
            module.options["block_dim"] = threads
            (path,) = wp.compile_aot_module(module, arch=arch, module_dir=folder, use_ptx=ptx)
        finally:
            wp.config.cuda_arch_suffix = suffix_before
            module.options["block_dim"] = before
        code = path.read_bytes()
    function = re.search(rb"[A-Za-z_]\w*_cuda_kernel_forward", code)[0].decode()
    return Binary(kind, arch, f"{kind}.sm{arch}{suffix}.{'ptx' if ptx else 'cubin'}", function, code)


def constants(net: MLP, schedule: RowsSchedule | None) -> dict[str, str]:
    """Of network.hpp."""
    from warp._src.types import array_t, launch_bounds_t

    spec: NetworkSpec = net.spec
    layers = ", ".join(f"{{{', '.join(map(str, row))}}}" for row in layer_table(spec, True))
    values = {
        "INPUTS": net.n_in,
        "OUTPUTS": spec.sizes[-1],
        "NETWORKS": net.count,
        "PRECISION": f"{net.precision}, sums in {spec.accumulation}",
        "FLOPS": f"{2.0 * sum(k * n for k, n in spec.layers):g}",
        "TOLERANCE": f"{2 * ROUNDING[net.precision] * sqrt(2 * len(spec.layers)):.3g}",
        "ELEMENT": "std::uint16_t" if spec.dtype is wp.float16 else "float",
        "WORDS": network_layout(spec, True)[1],
        "MASTER": net.master.size,
        "STEPS": net.steps.size,
        "PARAMETERS": spec.n_parameters,
        "KIND": kind_of(net.Params),
        "LAYERS": layers,
        "ROW_THREADS": BLOCK,
        "GROUP_THREADS": schedule.threads if schedule else 1,
        "GROUP_ROWS": schedule.block_rows if schedule else 1,
        "GROUP_BLOCKS": schedule.blocks if schedule else 1,
        "GROUP_BYTES": 4 * schedule.words if schedule else 0,
        "ARRAY_BYTES": ctypes.sizeof(array_t),
        "PARAMETERS_BYTES": ctypes.sizeof(Parameters.ctype),
        "BOUNDS_BYTES": ctypes.sizeof(launch_bounds_t((1,))),
    }
    return {key: str(value) for key, value in values.items()}


def fill(text: str, values: dict[str, str]) -> str:
    return re.sub("|".join(rf"\b{key}\b" for key in values), lambda match: values[match[0]], text)
