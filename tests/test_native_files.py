"""Each native file compiles alone, with the constants and after the names that its first comment asks for."""

from pathlib import Path

import warp as wp

import warp_neural.kernels
from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.coopvec.cuda.primitives import MATRICES
from warp_neural.kernels.coopvec.formats import SMALL_FLOATS
from warp_neural.kernels.coopvec.pool import OWN_POOL
from warp_neural.kernels.native import ATOMICS, paste, unroll
from warp_neural.kernels.nn.spec import E4M3

SHARED = Path(warp_neural.kernels.__file__).parent / "native"
REAL = "using real = wp::float32;\n"
LANES, HALVES, VECTORS = [paste(NATIVE / name) for name in ("lanes.cuh", "halves.cuh", "vectors.h")]
STAGING = LANES + OWN_POOL + paste(NATIVE / "staging.cuh", ROW_UNITS=4)
ROW = "char* bytes = reinterpret_cast<char*>(x.data); size_t pitch = 64, step = 2; bool aligned = true;\n"
ROW += "unsigned words[32];\n"

# file: (names declared before it, its constants)
CUDA = {
    "lanes.cuh": ("", {}),
    "halves.cuh": (REAL, {}),
    "pack_float16.cuh": (REAL + HALVES, {}),
    "pack_bfloat16.cuh": (REAL, {}),
    "pack_tf32.cuh": (REAL, {}),
    "pack_int8.cuh": (REAL, {}),
    "pack_e4m3.cuh": (REAL, {}),
    "pack_e5m2.cuh": (REAL + HALVES, {}),
    "gradients.cuh": (REAL + paste(NATIVE / "pack_bfloat16.cuh"), {}),
    "staging.cuh": (LANES + OWN_POOL, {"ROW_UNITS": 4}),
    "stage_rows.cuh": (f"{STAGING}integer row = 0; unsigned a[2][4][4];\n", {"INPUT_UNITS": 8}),
    "network_rows.cuh": (f"{LANES}unsigned long long key = 0u;\n", {}),
    "warp_sums.cuh": (f"{REAL}real* gradient = x.data;\n", {}),
    "matrices.cuh": (LANES, {}),
    "products.cuh": ("", {}),
    "rows_of_warp.cuh": (
        f"{LANES}{MATRICES}unsigned rows = 0u; wp::array_t<wp::half> y;\n",
        {"IN_UNITS": 6, "N_OUT": 9},
    ),
    "load_by_warp.cuh": (ROW + OWN_POOL, {"UNITS": 8, "MOST": 8}),
    "load_row.cuh": (f"{ROW}bool together = false;\n", {"N": 64, "SIZE": 2, "UNITS": 8}),
    "reduce_sum.cuh": (
        f"{REAL}{ATOMICS}real* target = x.data; const int step = 1; wp::vec_t<4, real> v;\n",
        {"N": 4, "WIDTH": 1},
    ),
}
CPU = {
    "vectors.h": ("", {}),
    "transposed_sum.h": (VECTORS, {}),
    "math.h": (VECTORS, {}),
    "round_small_float.h": (VECTORS, SMALL_FLOATS[E4M3]),
}
BOTH = {"atomics.cuh": (REAL, {}), "half_atomics.cuh": (REAL, {}), "encode_small_float.h": ("", SMALL_FLOATS[E4M3])}


def find(name: str) -> Path:
    return next(folder / name for folder in (NATIVE, SHARED) if (folder / name).exists())


def make_kernel(files: dict) -> wp.Kernel:
    """One module for all: a function of each."""

    def make_function(text: str) -> wp.Function:
        @wp.func_native(text)
        def function(x: wp.array2d[float], pool: wp.uint32): ...

        return function

    functions = [make_function(names + paste(find(name), **constants)) for name, (names, constants) in files.items()]

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(x: wp.array2d[float]):
        for i in range(wp.static(len(functions))):
            wp.static(functions[i])(x, wp.uint32(0))

    return kernel


def test_compile_for_hopper(tmp_path, monkeypatch):
    monkeypatch.setattr(wp.config, "cuda_arch_suffix", "a")
    (artifact,) = wp.compile_aot_module(make_kernel(CUDA | BOTH).module, arch=90, module_dir=tmp_path)
    assert artifact.stat().st_size > 0


def test_compile_for_the_cpu():
    wp.launch(make_kernel(CPU | BOTH), 1, [wp.zeros((1, 1), dtype=float, device="cpu")], device="cpu")


def test_every_file_is_here_and_names_its_constants():
    names = sorted(
        path.name for folder in (NATIVE, SHARED) for path in folder.iterdir() if path.suffix in (".cuh", ".h")
    )
    assert names == sorted(CUDA | CPU | BOTH)
    for name, (_, constants) in (CUDA | CPU | BOTH).items():
        comment = find(name).read_text().split("\n\n")[0]
        assert comment.startswith("// ") and all(f"{constant}" in comment for constant in constants), name


def test_loops_that_are_unrolled_say_so():
    text = "UNROLL for (int i = 0; i < 4; ++i) for (int j = 0; j < 4; ++j) f(i, j);"
    assert unroll(text).split("\n")[1:] == ["#pragma unroll", text.removeprefix("UNROLL ")]
