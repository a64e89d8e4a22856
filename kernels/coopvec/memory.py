"""Vectors to and from rows of memory, 16 bytes at a time (GL_NV_cooperative_vector: coopVecLoadNV, coopVecStoreNV).

`array[i]` on an array of vectors moves one element at a time; a row of 32 halves is 32 loads instead of 4.
"""

from functools import cache

import warp as wp

from kernels.coopvec.spec import C_TYPES

SIZES = {wp.float16: 2, wp.float32: 4}
ROW = "const size_t pitch = {array}.strides[0]; char* const bytes = reinterpret_cast<char*>({data}) + row * pitch;\n"


def by_16_bytes(n: int, dtype: type, wide: str, element: str) -> str:
    """`wide` for each 16 bytes `u` where the row allows it on CUDA, `element` for each element `i` otherwise."""
    units = n * SIZES[dtype] // 16 if n * SIZES[dtype] % 16 == 0 else 0
    fast = f"""if (((reinterpret_cast<size_t>(bytes) | pitch) & 15u) == 0u) {{
#pragma unroll
for (int u = 0; u < {units}; ++u) {{ {wide} }}
}} else"""
    return f"""#if defined(__CUDA_ARCH__)
{fast if units else ""}
#endif
for (int i = 0; i < {n}; ++i) {{ {element} }}
"""


@cache
def make_load(n: int, dtype: type) -> wp.Function:
    """`(source: array2d [rows, >= n] of dtype, row: int) -> vector of n`; differentiable."""
    vec = wp.types.vector(n, dtype)
    per_unit = 16 // SIZES[dtype]
    take = (
        "v.c[u * 8 + 2 * w].u = words[w] & 0xffffu; v.c[u * 8 + 2 * w + 1].u = words[w] >> 16;"
        if per_unit == 8
        else "v.c[u * 4 + w] = __uint_as_float(words[w]);"
    )
    wide = f"""const uint4 q = reinterpret_cast<const uint4*>(bytes)[u];
const unsigned words[4] = {{q.x, q.y, q.z, q.w}};
for (int w = 0; w < 4; ++w) {{ {take} }}"""
    c_type = C_TYPES[dtype]
    text = f"wp::vec_t<{n}, {c_type}> v;\n" + ROW.format(array="source", data="source.data")
    text += by_16_bytes(n, dtype, wide, f"v.c[i] = reinterpret_cast<{c_type}*>(bytes)[i];") + "return v;\n"
    gradient = "if (source.grad) {\n" + ROW.format(array="source", data="source.grad")
    gradient += (
        f"for (int i = 0; i < {n}; ++i) wp::atomic_add(reinterpret_cast<{c_type}*>(bytes) + i, adj_ret.c[i]);\n}}\n"
    )

    @wp.func_native(text, adj_snippet=gradient)
    def load(source: wp.array2d(dtype=dtype), row: int) -> vec: ...

    return load


@cache
def make_store(n: int, dtype: type) -> wp.Function:
    """`(target: array2d [rows, >= n] of dtype, row: int, v: vector of n)`; differentiable."""
    vec = wp.types.vector(n, dtype)
    per_unit = 16 // SIZES[dtype]
    word = (
        "v.c[u * 8 + 2 * w].u | static_cast<unsigned>(v.c[u * 8 + 2 * w + 1].u) << 16"
        if per_unit == 8
        else "__float_as_uint(v.c[u * 4 + w])"
    )
    wide = f"""unsigned words[4];
for (int w = 0; w < 4; ++w) words[w] = {word};
reinterpret_cast<uint4*>(bytes)[u] = make_uint4(words[0], words[1], words[2], words[3]);"""
    c_type = C_TYPES[dtype]
    text = ROW.format(array="target", data="target.data")
    text += by_16_bytes(n, dtype, wide, f"reinterpret_cast<{c_type}*>(bytes)[i] = v.c[i];")
    gradient = "if (target.grad) {\n" + ROW.format(array="target", data="target.grad")
    gradient += f"for (int i = 0; i < {n}; ++i) adj_v.c[i] += reinterpret_cast<{c_type}*>(bytes)[i];\n}}\n"

    @wp.func_native(text, adj_snippet=gradient)
    def store(target: wp.array2d(dtype=dtype), row: int, v: vec): ...

    return store
