"""A whole network as one function of the calling thread: native code for the CPU and for CUDA behind one signature."""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.cpu import network as cpu
from warp_neural.kernels.coopvec.cuda import network as cuda
from warp_neural.kernels.coopvec.pool import pool
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

    @wp.func_native(both(cpu.network_text(spec), cuda.network_text(spec)))
    def network_forward(params: Parameters, x: vec_in, pool: wp.uint32) -> vec_out: ...

    @wp.func_native(both(cpu.adjoint_text(spec), cuda.adjoint_text(spec)))
    def network_adjoint(params: Parameters, x: vec_in, dy: vec_out, pool: wp.uint32) -> vec_in: ...

    @wp.func
    def network(params: Parameters, x: vec_in) -> vec_out:
        return network_forward(params, x, pool())

    @wp.func_grad(network)
    def adj_network(params: Parameters, x: vec_in, adj_ret: vec_out):
        wp.adjoint[x] += network_adjoint(params, x, adj_ret, pool())

    network.adjoint = network_adjoint  # for functions around it: their own adjoints would evaluate the network again
    return network
