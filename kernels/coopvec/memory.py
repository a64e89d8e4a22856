"""Vectors to and from rows of memory, 16 bytes at a time (GL_NV_cooperative_vector: coopVecLoadNV, coopVecStoreNV).

`array[i]` on an array of vectors moves one element at a time; a row of 32 halves is 32 loads instead of 4.
"""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec import NATIVE
from warp_neural.kernels.coopvec.pool import OWN_POOL, pool
from warp_neural.kernels.native import paste
from warp_neural.kernels.nn.spec import C_TYPES, check_vector

SIZES = {wp.float16: 2, wp.float32: 4}
ROW = """const size_t pitch = {array}.strides[0], step = {array}.strides[1];  // of rows, of elements
char* const bytes = reinterpret_cast<char*>({data}) + row * pitch;
"""
MIN_UNITS = 4  # of 16 bytes in a row, for the warp to load it together: shorter ones gain nothing


def aligned_units(n: int, dtype: type) -> int:
    """16-byte units of a row that can be moved whole, where row and pitch are aligned."""
    return n * SIZES[dtype] // 16 if n * SIZES[dtype] % 16 == 0 else 0


def each_element(n: int, dtype: type, use: str) -> str:
    """`use` of the row's elements `e` and those of a vector, i. Side by side, the compiler can take several at once."""
    body = f"{{ {C_TYPES[dtype]}& e = *reinterpret_cast<{C_TYPES[dtype]}*>(bytes + i * STEP); {use} }}"
    loop = f"for (size_t i = 0; i < {n}; ++i) {body}\n"
    return f"if (step == {SIZES[dtype]}u) {loop.replace('STEP', str(SIZES[dtype]))}else {loop.replace('STEP', 'step')}"


def load_text(n: int, dtype: type) -> str:
    """CUDA: the row `bytes` to `v`."""
    size, units = SIZES[dtype], aligned_units(n, dtype)
    together = "constexpr bool together = false;\n"
    if units >= MIN_UNITS:
        most = 1 << (units - 1).bit_length()
        together = OWN_POOL + paste(NATIVE / "load_by_warp.cuh", UNITS=units, MOST=most)
    else:
        together += f"constexpr int UNITS = {units};\n"
    split = "v.c[i].u = words[i / 2] >> i % 2 * 16;" if size == 2 else "v.c[i] = __uint_as_float(words[i]);"
    return f"""unsigned words[{-(-n * size // 4)}] = {{}};
const bool aligned = ((reinterpret_cast<size_t>(bytes) | pitch) & 15u) == 0u && step == {size}u;
{together}{paste(NATIVE / "load_row.cuh", N=n, SIZE=size)}
#pragma unroll
for (int i = 0; i < {n}; ++i) {split}
"""


@cache
def make_load(n: int, dtype: type) -> wp.Function:
    """`(source: array2d [rows, >= n] of dtype, row: int) -> vector of n`; differentiable. Any strides."""
    check_vector(n, dtype)
    vec, c_type = wp.types.vector(n, dtype), C_TYPES[dtype]
    text = f"wp::vec_t<{n}, {c_type}> v;\n" + ROW.format(array="source", data="source.data")
    text += f"""#if defined(__CUDA_ARCH__)
{load_text(n, dtype)}
#else
{each_element(n, dtype, "v.c[i] = e;")}#endif
return v;
"""
    gradient = "if (source.grad) {\n" + ROW.format(array="source", data="source.grad")
    gradient += each_element(n, dtype, "wp::atomic_add(&e, dv.c[i]);") + "}\n"

    @wp.func_native(text)
    def load_row(source: wp.array2d(dtype=dtype), row: int, pool: wp.uint32) -> vec: ...

    @wp.func_native(gradient)
    def load_adjoint(source: wp.array2d(dtype=dtype), row: int, dv: vec): ...

    @wp.func
    def load(source: wp.array2d(dtype=dtype), row: int) -> vec:
        return load_row(source, row, pool())

    @wp.func_grad(load)
    def adj_load(source: wp.array2d(dtype=dtype), row: int, adj_ret: vec):
        load_adjoint(source, row, adj_ret)

    return load


@cache
def make_store(n: int, dtype: type) -> wp.Function:
    """`(target: array2d [rows, >= n] of dtype, row: int, v: vector of n)`; differentiable. Any strides."""
    check_vector(n, dtype)
    vec = wp.types.vector(n, dtype)
    per_unit = 16 // SIZES[dtype]
    word = (
        "v.c[u * 8 + 2 * w].u | static_cast<unsigned>(v.c[u * 8 + 2 * w + 1].u) << 16"
        if per_unit == 8
        else "__float_as_uint(v.c[u * 4 + w])"
    )
    store_unit = f"""unsigned words[4];
for (int w = 0; w < 4; ++w) words[w] = {word};
reinterpret_cast<uint4*>(bytes)[u] = make_uint4(words[0], words[1], words[2], words[3]);"""
    units = aligned_units(n, dtype)
    fast = f"""if (((reinterpret_cast<size_t>(bytes) | pitch) & 15u) == 0u && step == {SIZES[dtype]}u) {{
#pragma unroll
for (int u = 0; u < {units}; ++u) {{ {store_unit} }}
return;
}}"""
    text = ROW.format(array="target", data="target.data")
    text += f"""#if defined(__CUDA_ARCH__)
{fast if units else ""}
#endif
{each_element(n, dtype, "e = v.c[i];")}"""
    gradient = "if (target.grad) {\n" + ROW.format(array="target", data="target.grad")
    gradient += each_element(n, dtype, "adj_v.c[i] += e;") + "}\n"

    @wp.func_native(text, adj_snippet=gradient)
    def store(target: wp.array2d(dtype=dtype), row: int, v: vec): ...

    return store
