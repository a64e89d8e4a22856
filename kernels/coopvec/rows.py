"""Networks whose inputs are rows of memory: a warp reads its rows together, straight to where its layers take them."""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.cuda import network as cuda
from warp_neural.kernels.coopvec.cuda.warpgroup_rows import RowsSchedule, rows_by_warpgroups_text
from warp_neural.kernels.coopvec.memory import make_load, make_store
from warp_neural.kernels.coopvec.pool import pool
from warp_neural.kernels.native import both
from warp_neural.kernels.nn.spec import FLOAT16, NetworkSpec, Parameters

BLOCK = 64  # threads of a block that evaluates rows: with few, more of a row is staged at a time
FOLLOW = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
if (__activemask() != 0xffffffffu) return false;
const bool aligned = ((reinterpret_cast<size_t>(x.data) | x.strides[0]) & 15u) == 0u && x.strides[1] == 2;
const wp::int32 first = __shfl_sync(0xffffffffu, row, 0), lane = threadIdx.x & 31u;
return __all_sync(0xffffffffu, aligned && row == first + lane);
#else
return false;
#endif
"""


@wp.func_native(FOLLOW)
def rows_follow(x: wp.array2d[wp.float16], row: int) -> bool:
    """Whether a whole warp has rows of x that follow each other, aligned to 16 bytes; the same in all its lanes."""
    ...


@cache
def make_of_row(func: wp.Function, vec_in: type) -> wp.Function:
    """`(params, x: array2d [rows, n_in], row) -> func(params, x[row])`."""
    load = make_load(vec_in._length_, vec_in._wp_scalar_type_)

    @wp.func
    def of_row(params: Parameters, x: wp.array2d(dtype=vec_in._wp_scalar_type_), row: int):
        return func(params, load(x, row))

    return of_row


@cache
def make_of_row_together(spec: NetworkSpec, network: wp.Function) -> wp.Function:
    """The same, faster on CUDA, for networks whose first layer takes rows as they stand: `can_read_together`."""
    vec_out, alone = spec.vec_out, make_of_row(network, spec.vec_in)

    @wp.func_native(f"#if defined(__CUDA_ARCH__)\n{cuda.rows_text(spec)}\n#else\nreturn {{}};\n#endif\n")
    def together(params: Parameters, x: wp.array2d[wp.float16], row: int, pool: wp.uint32) -> vec_out: ...

    @wp.func
    def of_row(params: Parameters, x: wp.array2d[wp.float16], row: int) -> vec_out:
        y = vec_out()
        if rows_follow(x, row):
            y = together(params, x, row, pool())
        else:
            y = alone(params, x, row)
        return y

    return of_row


def can_read_together(spec: NetworkSpec) -> bool:
    return spec.format is FLOAT16 and spec.dtype is wp.float16 and spec.sizes[0] % 16 == 0


@cache
def make_evaluate_kernel(of_row: wp.Function, vec_out: type) -> wp.Kernel:
    """`y[i] = of_row(params, x, i)` for every row; dim: the rows, rounded up to whole blocks."""
    params_type = of_row.input_types["params"]
    scalar, store = vec_out._wp_scalar_type_, make_store(vec_out._length_, vec_out._wp_scalar_type_)

    @wp.kernel(module="unique", enable_backward=False, module_options={"enable_mathdx_gemm": False})
    def evaluate_kernel(params: params_type, x: wp.array2d(dtype=scalar), y: wp.array2d(dtype=scalar)):
        i = wp.tid()
        result = of_row(params, x, wp.min(i, x.shape[0] - 1))
        if i < x.shape[0]:
            store(y, i, result)

    return evaluate_kernel


@cache
def make_warpgroup_kernel(spec: NetworkSpec, schedule: RowsSchedule) -> wp.Kernel:
    """The same of networks that `make_rows_schedule` takes, for rows of x aligned to 16 bytes and dense y.

    dim: any number of blocks * schedule.threads; block_dim: schedule.threads."""
    shared, words = wp.tile(dtype=wp.uint32, shape=(schedule.words,)), schedule.words

    @wp.func_native(both("", rows_by_warpgroups_text(spec, schedule)))
    def evaluate_rows(params: Parameters, memory: shared, x: wp.array2d[wp.float16], y: wp.array2d[wp.float16]): ...

    bounds = (schedule.threads, schedule.blocks)

    @wp.kernel(module="unique", enable_backward=False, launch_bounds=bounds)
    def evaluate_kernel(params: Parameters, x: wp.array2d[wp.float16], y: wp.array2d[wp.float16]):
        memory = wp.tile_empty(shape=words, dtype=wp.uint32, storage="shared")
        evaluate_rows(params, memory, x, y)

    return evaluate_kernel


@cache
def make_adjoint_kernel(network: wp.Function | None, encode: wp.Function | None, gradient: wp.Function | None):
    """Of each row of x and dy, float32: adds to `params.master.grad`, unless that is null, and writes the row of dx,
    unless dx has no rows; dim: the rows, rounded up to whole blocks.

    network: the adjoint of `make_network`, or None for an encoding alone. encode, gradient: `Encoding.make` and
    `make_encode_gradient`, or None for a network alone.
    """
    vec_in = (encode or network).input_types["x"]
    vec_out = (network or gradient).input_types["dy"]
    load_x, load_dy = (make_load(vec._length_, wp.float32) for vec in (vec_in, vec_out))
    store = make_store(vec_in._length_, wp.float32)

    @wp.kernel(module="unique", enable_backward=False)
    def adjoint_kernel(params: Parameters, x: wp.array2d[float], dy: wp.array2d[float], dx: wp.array2d[float]):
        i, last = wp.tid(), x.shape[0] - 1
        v = load_x(x, wp.min(i, last))
        d = load_dy(dy, wp.min(i, last))
        if i > last:  # of a whole warp, which multiplies together
            d = vec_out()
        if wp.static(encode is None):
            result = network(params, v, d, pool())
        elif wp.static(network is None):
            result = gradient(params, v, d)
        else:
            result = gradient(params, v, network(params, encode(params, v), d, pool()))
        if i < dx.shape[0]:
            store(dx, i, result)

    return adjoint_kernel
