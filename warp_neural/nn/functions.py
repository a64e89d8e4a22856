"""What kernels call of a network: its functions, for any thread of any kernel."""

from functools import cached_property
from typing import Any

import warp as wp

from warp_neural.kernels.coopvec.network import make_network
from warp_neural.kernels.coopvec.rows import can_read_together, make_of_row, make_of_row_together
from warp_neural.kernels.coopvec.typed import make_params_type, make_select, make_typed, make_typed_of_row
from warp_neural.kernels.nn.encodings.network import make_encoded
from warp_neural.kernels.nn.mlp import make_mlp, make_tiled_mlp
from warp_neural.kernels.nn.spec import Parameters
from warp_neural.nn.kind import Kind

FACTORIES = {"cooperative": make_network, "per_thread": make_mlp, "tiled": make_tiled_mlp}


class Functions(Kind):
    """Of a network of this kind. Those that begin with `plain` take `Parameters`, as kernels of the library do."""

    Params: Any = Parameters  # of any network, for what stands in for one; an MLP's are of its shape alone

    def params_type(self) -> Any:
        """The struct of parameters of this shape alone."""
        start = self.encoding_start if self.encoding else 0
        return make_params_type(self.spec, self.encoding, self.n_in, start)

    @property
    def vec_in(self) -> type:
        return wp.types.vector(self.n_in, self.spec.dtype)

    @property
    def vec_out(self) -> type:
        return self.spec.vec_out

    @cached_property
    def func(self) -> wp.Function:
        """`(params: net.Params, x: net.vec_in) -> net.vec_out`, for any thread of any kernel.

        NaN for parameters of a network of another shape, and where `params.network` is none of the `count`.
        """
        network = make_typed(self.plain_network, self.Params, self.vec_out)
        return make_encoded(network, self.encode) if self.encoding else network

    @cached_property
    def encode(self) -> wp.Function:
        """The encoding alone, `(params: net.Params, x: net.vec_in) -> vec`."""
        n_out = self.encoding.n_out(self.n_in)
        return make_typed(self.plain_encode, self.Params, wp.types.vector(n_out, wp.float32))

    @cached_property
    def plain_func(self) -> wp.Function:
        """`func` of `net.plain`, as kernels of the library call it."""
        return make_encoded(self.plain_network, self.plain_encode) if self.encoding else self.plain_network

    @cached_property
    def plain_network(self) -> wp.Function:
        """Without the encoding."""
        return FACTORIES[self.implementation](self.spec)

    @cached_property
    def plain_encode(self) -> wp.Function:
        return self.encoding.make(self.n_in, self.encoding_start)

    @property
    def select(self) -> wp.Function:
        """`(params: net.Params, i: int) -> net.Params` with network i selected."""
        return make_select(self.Params)

    @cached_property
    def of_row(self) -> wp.Function:
        """`(params: net.Params, x: array2d [rows, n_in], row: int) -> net.vec_out`: `func` of a row. Forward only."""
        return make_typed_of_row(self.plain_of_row, self.Params, self.vec_out)

    @cached_property
    def plain_of_row(self) -> wp.Function:
        together = self.encoding is None and self.implementation == "cooperative" and can_read_together(self.spec)
        func = self.plain_func
        return make_of_row_together(self.spec, func) if together else make_of_row(func, self.vec_in)
