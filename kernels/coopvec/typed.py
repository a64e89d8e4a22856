"""A type of parameters for each shape of network, so that the buffers of another are not read.

Where a kernel calls a network with parameters of another type, Warp refuses it. At a launch Warp 1.19 looks at no
struct's type: so all types have the same members, `kind` says which it is, and a function that gets another, or a
`network` that is not there, returns NaN and reads nothing.
"""

from functools import cache
from hashlib import sha256
from typing import Any

import warp as wp

from warp_neural.kernels.coopvec.pool import pool
from warp_neural.kernels.nn.spec import NetworkSpec, Parameters


@cache
def make_params_type(spec: NetworkSpec, encoding: Any, n_in: int, start: int) -> Any:
    """The struct, with the members of `Parameters`. encoding: of n_in inputs, whose parameters begin at `start` of
    `master`, or None."""
    shape = repr((spec, encoding, n_in, start) if encoding else spec)
    sizes = "_".join(map(str, spec.sizes))

    class Params(Parameters.cls):
        __annotations__ = dict(Parameters.cls.__annotations__)

    Params.__name__ = f"Params_{sizes}_{spec.format.name}_{sha256(shape.encode()).hexdigest()[:8]}"
    Params.__qualname__ = Params.__name__
    return wp.struct(Params)


def kind_of(params_type: Any) -> int:
    """What `params.kind` is, from 1 on: the same in every process, as it is part of a kernel's text."""
    return int(params_type.key[-7:], 16) + 1


@cache
def make_plain(params_type: Any) -> wp.Function:
    """`(params) -> Parameters`, as the library's own functions take them."""

    @wp.func
    def plain(params: params_type) -> Parameters:
        result = Parameters()
        result.packed = params.packed
        result.master = params.master
        result.network = params.network
        result.count = params.count
        result.kind = params.kind
        return result

    return plain


@cache
def make_fits(params_type: Any) -> wp.Function:
    """Whether parameters are of this type and their network is there."""
    kind = wp.constant(kind_of(params_type))

    @wp.func
    def fits(params: params_type) -> bool:
        return params.kind == kind and params.network >= 0 and params.network < params.count

    return fits


@cache
def make_typed(function: wp.Function, params_type: Any, vec_out: type) -> wp.Function:
    """`(params, x)` of `function`, which takes `Parameters`, for parameters of this type alone."""
    vec_in, dtype = function.input_types["x"], vec_out._wp_scalar_type_
    plain, fits = make_plain(params_type), make_fits(params_type)

    @wp.func
    def typed(params: params_type, x: vec_in) -> vec_out:
        if not fits(params):
            return vec_out(dtype(wp.nan))
        return function(plain(params), x)

    if hasattr(function, "adjoint"):
        add_adjoint(typed, function.adjoint, plain, fits)
    return typed


def add_adjoint(typed: wp.Function, adjoint: wp.Function, plain: wp.Function, fits: wp.Function) -> None:
    """Warp's own would evaluate the network once more."""
    params_type, vec_in = typed.input_types["params"], typed.input_types["x"]
    vec_out = adjoint.input_types["dy"]

    @wp.func_grad(typed)
    def adj_typed(params: params_type, x: vec_in, adj_ret: vec_out):
        if fits(params):
            wp.adjoint[x] += adjoint(plain(params), x, adj_ret, pool())


@cache
def make_typed_of_row(function: wp.Function, params_type: Any, vec_out: type) -> wp.Function:
    """The same of `(params, x, row)`."""
    rows, dtype = function.input_types["x"], vec_out._wp_scalar_type_
    plain, fits = make_plain(params_type), make_fits(params_type)

    @wp.func
    def typed(params: params_type, x: rows, row: int) -> vec_out:
        if not fits(params):
            return vec_out(dtype(wp.nan))
        return function(plain(params), x, row)

    return typed


@cache
def make_select(params_type: Any) -> wp.Function:
    """`(params, network) -> params` with another of its networks."""

    @wp.func
    def select(params: params_type, network: int) -> params_type:
        selected = params
        selected.network = network
        return selected

    return select
