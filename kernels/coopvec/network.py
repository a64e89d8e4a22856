"""A whole network as one function of the calling thread: native code for the CPU and for CUDA behind one signature."""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.cpu import network as cpu
from warp_neural.kernels.coopvec.cuda import network as cuda
from warp_neural.kernels.native import both
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters


@cache
def make_network(spec: NetworkSpec) -> wp.Function:
    """`(params: Parameters, x: spec.vec_in) -> spec.vec_out`, differentiable in x and in `params.master`.

    Any thread may call it under any control flow, each with its own `params.network`. On CUDA, warps whose 32 lanes
    arrive together multiply on the tensor cores; other threads get the same result by per-thread arithmetic. At 64
    neurons a kernel with `launch_bounds=(block, 512 // block)` may run faster: its threads keep to 128 registers.
    """
    vec_in, vec_out = spec.vec_in, spec.vec_out

    @wp.func_native(
        both(cpu.forward(spec), cuda.forward(spec)), adj_snippet=both(cpu.adjoint(spec), cuda.adjoint(spec))
    )
    def network(params: Parameters, x: vec_in) -> vec_out: ...

    return network
