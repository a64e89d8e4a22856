"""Vectors to and from rows of memory, 16 bytes at a time (GL_NV_cooperative_vector: coopVecLoadNV, coopVecStoreNV).

`array[i]` on an array of vectors moves one element at a time; a row of 32 halves is 32 loads instead of 4.
"""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.pool import OWN, pool
from warp_neural.kernels.nn.spec import C_TYPES, check_vector

SIZES = {wp.float16: 2, wp.float32: 4}
ROW = "const size_t pitch = {array}.strides[0]; char* const bytes = reinterpret_cast<char*>({data}) + row * pitch;\n"
MIN_UNITS = 4  # of 16 bytes in a row, for the warp to load it together: shorter ones gain nothing


def aligned_units(n: int, dtype: type) -> int:
    """16-byte units of a row that can be moved whole, where row and pitch are aligned."""
    return n * SIZES[dtype] // 16 if n * SIZES[dtype] % 16 == 0 else 0


def load_words(n: int, dtype: type) -> str:
    """CUDA: the row as 32-bit `words`; only together are they split, so that what packs them again costs nothing."""
    units, half = aligned_units(n, dtype), dtype is wp.float16
    bits = (
        "reinterpret_cast<const unsigned short*>(bytes)[i]" if half else "reinterpret_cast<const unsigned*>(bytes)[i]"
    )
    place = "words[i / 2] |= static_cast<unsigned>({}) << i % 2 * 16;" if half else "words[i] = {};"
    split = "v.c[i].u = words[i / 2] >> i % 2 * 16;" if half else "v.c[i] = __uint_as_float(words[i]);"
    take = "words[4 * u] = q.x; words[4 * u + 1] = q.y; words[4 * u + 2] = q.z; words[4 * u + 3] = q.w;"
    row = (
        f"""if (aligned) {{
#pragma unroll
for (int u = 0; u < {units}; ++u) {{ const uint4 q = reinterpret_cast<const uint4*>(bytes)[u]; {take} }}
}} else"""
        if units
        else ""
    )
    return f"""unsigned words[{-(-n * SIZES[dtype] // 4)}] = {{}};
const bool aligned = ((reinterpret_cast<size_t>(bytes) | pitch) & 15u) == 0u;
{by_warp(units, take) if units >= MIN_UNITS else ""}
{{ {row}
#pragma unroll
for (int i = 0; i < {n}; ++i) {{ {place.format(bits)} }} }}
#pragma unroll
for (int i = 0; i < {n}; ++i) {{ {split} }}
"""


def by_warp(units: int, take: str) -> str:
    """`if` a whole warp loads consecutive rows `else`: 16 bytes a lane in order of memory, dealt out in shared memory.

    With a row a thread, every load touches 32 lines of the cache. take: statements that take unit `u` from `q`.
    """
    most = 1 << (units - 1).bit_length()
    return f"""#if __CUDA_ARCH__ >= 800
const unsigned lane = threadIdx.x & 31u;
size_t first = 0;
bool together = __activemask() == 0xffffffffu;
if (together) {{
    first = __shfl_sync(0xffffffffu, reinterpret_cast<size_t>(bytes), 0);
    together = __all_sync(0xffffffffu, aligned && reinterpret_cast<size_t>(bytes) == first + lane * pitch);
}}
if (together) {{
{OWN}
constexpr unsigned UNITS = CHUNK < {most} ? CHUNK : {most};
auto place = [&](unsigned row, unsigned u) {{  // swizzled: no two of eight lanes meet in a bank
    return own_pool + row * UNITS + (u ^ (UNITS == 8 ? row & 7u : UNITS == 4 ? row >> 1 & 3u : row >> 2 & 1u)); }};
const unsigned own = lane % UNITS, above = lane / UNITS;  // the unit of a chunk, and the row, that this lane moves
auto source = [&](unsigned c, unsigned r) {{
    return reinterpret_cast<const uint4*>(first + (32 / UNITS * r + above) * pitch) + c + own; }};
auto inside = [&](unsigned c) {{ return c + UNITS <= {units} || c + own < {units}; }};
constexpr bool AHEAD = UNITS < {units};  // in several chunks: wait for memory once
uint4 ahead[{units} + UNITS];
#pragma unroll
for (unsigned c = 0; c < {units} && AHEAD; c += UNITS)
#pragma unroll
for (unsigned r = 0; r < UNITS; ++r) if (inside(c)) ahead[c + r] = __ldcg(source(c, r));
#pragma unroll
for (unsigned c = 0; c < {units}; c += UNITS) {{  // units of a row staged at a time
#pragma unroll
for (unsigned r = 0; r < UNITS; ++r) if (inside(c)) {{
    uint4* const target = place(32 / UNITS * r + above, own);
    if (AHEAD) *target = ahead[c + r];
    else asm volatile("cp.async.cg.shared.global [%0],[%1],16;"
        :: "r"(static_cast<unsigned>(__cvta_generic_to_shared(target))), "l"(source(c, r)) : "memory");
}}
if (!AHEAD) asm volatile("cp.async.wait_all;" ::: "memory");
__syncwarp();
#pragma unroll
for (unsigned u = c; u < c + UNITS && u < {units}; ++u) {{ const uint4 q = *place(lane, u - c); {take} }}
__syncwarp();
}}
}} else
#endif
"""


@cache
def make_load(n: int, dtype: type) -> wp.Function:
    """`(source: array2d [rows, >= n] of dtype, row: int) -> vector of n`; differentiable."""
    check_vector(n, dtype)
    vec, c_type = wp.types.vector(n, dtype), C_TYPES[dtype]
    text = f"wp::vec_t<{n}, {c_type}> v;\n" + ROW.format(array="source", data="source.data")
    text += f"""#if defined(__CUDA_ARCH__)
{load_words(n, dtype)}
#else
for (int i = 0; i < {n}; ++i) v.c[i] = reinterpret_cast<{c_type}*>(bytes)[i];
#endif
return v;
"""
    gradient = "if (source.grad) {\n" + ROW.format(array="source", data="source.grad")
    gradient += f"for (int i = 0; i < {n}; ++i) wp::atomic_add(reinterpret_cast<{c_type}*>(bytes) + i, dv.c[i]);\n}}\n"

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
    """`(target: array2d [rows, >= n] of dtype, row: int, v: vector of n)`; differentiable."""
    check_vector(n, dtype)
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
    units = aligned_units(n, dtype)
    fast = f"""if (((reinterpret_cast<size_t>(bytes) | pitch) & 15u) == 0u) {{
#pragma unroll
for (int u = 0; u < {units}; ++u) {{ {wide} }}
}} else"""
    text = ROW.format(array="target", data="target.data")
    text += f"""#if defined(__CUDA_ARCH__)
{fast if units else ""}
#endif
for (int i = 0; i < {n}; ++i) reinterpret_cast<{c_type}*>(bytes)[i] = v.c[i];
"""
    gradient = "if (target.grad) {\n" + ROW.format(array="target", data="target.grad")
    gradient += f"for (int i = 0; i < {n}; ++i) adj_v.c[i] += reinterpret_cast<{c_type}*>(bytes)[i];\n}}\n"

    @wp.func_native(text, adj_snippet=gradient)
    def store(target: wp.array2d(dtype=dtype), row: int, v: vec): ...

    return store
