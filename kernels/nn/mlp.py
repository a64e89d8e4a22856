"""The network in plain Warp, two ways: loops of one thread (the specification) and tiles of a whole block.

Both read the float32 master parameters, and have the signature of `kernels.coopvec.network.make_network`.
"""

from functools import cache, reduce

import warp as wp

from warp_neural.kernels.nn.activations import Activation
from warp_neural.kernels.nn.spec import FLOAT16, NetworkSpec, Parameters


@cache
def make_mlp(spec: NetworkSpec) -> wp.Function:
    """`(params: Parameters, x: spec.vec_in) -> spec.vec_out`: what every other version is compared with."""
    functions, offset = [make_cast(spec.sizes[0], spec.dtype, wp.float32)], 0
    for index, (n_in, n_out) in enumerate(spec.layers):
        functions.append(make_linear(n_in, n_out, offset, spec.n_parameters))
        functions.append(make_elementwise(spec.activation_of(index), n_out))
        offset += n_out * n_in + n_out
    functions.append(make_cast(spec.sizes[-1], wp.float32, spec.dtype))
    return reduce(compose, functions)


def compose(first: wp.Function, second: wp.Function) -> wp.Function:
    vec = first.input_types["x"]

    @wp.func
    def composed(params: Parameters, x: vec):
        return second(params, first(params, x))

    return composed


# `wp.adjoint[params.master]` follows only the kernel's own argument, not a copy whose `network` a thread has set
@wp.func_native("if (params.master.grad) wp::atomic_add(params.master.grad + index, value);")
def accumulate_gradient(params: Parameters, index: int, value: float): ...


@cache
def make_linear(n_in: int, n_out: int, offset: int, n_parameters: int) -> wp.Function:
    """W x + b of the layer at `offset` in a network's parameters. The adjoint is written out: Warp does not replay
    loops of more than 16 trips, and the gradient that it then makes is silently wrong."""
    vec_in, vec_out = wp.types.vector(n_in, float), wp.types.vector(n_out, float)

    @wp.func
    def linear(params: Parameters, x: vec_in) -> vec_out:
        rows, columns = int(n_out), int(n_in)  # variables, so that Warp does not unroll the loops
        weights = params.network * n_parameters + offset
        biases = weights + n_out * n_in
        y = vec_out()
        for n in range(rows):
            total = params.master[biases + n]
            for k in range(columns):
                total += params.master[weights + n * n_in + k] * x[k]
            y[n] = total
        return y

    @wp.func_grad(linear)
    def adj_linear(params: Parameters, x: vec_in, adj_ret: vec_out):
        rows, columns = int(n_out), int(n_in)
        weights = params.network * n_parameters + offset
        biases = weights + n_out * n_in
        for n in range(rows):
            accumulate_gradient(params, biases + n, adj_ret[n])
            for k in range(columns):
                accumulate_gradient(params, weights + n * n_in + k, adj_ret[n] * x[k])
                wp.adjoint[x][k] += adj_ret[n] * params.master[weights + n * n_in + k]

    return linear


@cache
def make_elementwise(activation: Activation, length: int) -> wp.Function:
    """The activation of each element of a vector."""
    vec = wp.types.vector(length, float)
    value, slope = activation.func, activation.slope

    @wp.func
    def elementwise(params: Parameters, x: vec) -> vec:
        count = int(length)
        y = vec()
        for i in range(count):
            y[i] = value(x[i])
        return y

    @wp.func_grad(elementwise)
    def adj_elementwise(params: Parameters, x: vec, adj_ret: vec):
        count = int(length)
        for i in range(count):
            wp.adjoint[x][i] += adj_ret[i] * slope(x[i])

    return elementwise


@cache
def make_cast(length: int, source: type, target: type) -> wp.Function:
    """The conversion of a vector's elements."""
    vec_in, vec_out = wp.types.vector(length, source), wp.types.vector(length, target)

    @wp.func
    def cast(params: Parameters, x: vec_in) -> vec_out:
        return vec_out(x)

    return cast


@cache
def make_tiled_mlp(spec: NetworkSpec) -> wp.Function:
    """The network by `wp.tile_matmul`, a whole block at a time, on every device that Warp knows.

    Calling condition: every thread of the block makes the call, together and with the same `params.network`, and the
    launch (`wp.launch` with any `block_dim`, or `wp.launch_tiled`) has no partial block. One layer's weights and the
    block's vectors must fit into shared memory. Float16 multiplies float16 tiles and sums in float32; all other
    formats are float32.
    """
    vec_in, vec_out = spec.vec_in, spec.vec_out
    float_in, float_out = wp.types.vector(spec.sizes[0], float), wp.types.vector(spec.sizes[-1], float)
    sizes, half, last, n_parameters = spec.sizes, spec.format is FLOAT16, len(spec.layers) - 1, spec.n_parameters
    counts = [n * k for k, n in spec.layers]
    offsets = spec.offsets
    hidden, output = spec.activation.func, spec.output_activation.func

    @wp.func
    def layers(params: Parameters, x: vec_in, hidden: wp.Function, output: wp.Function) -> vec_out:
        block_dim = len(wp.tile(0.0))  # the one way to have it as a constant
        h = wp.tile(float_in(x))  # [n_in, block_dim]
        for i in range(wp.static(last + 1)):  # unrolled
            start = params.network * n_parameters + wp.static(offsets[i])
            weights = wp.tile_load(params.master, shape=wp.static(counts[i]), offset=start)
            bias = wp.tile_load(params.master, shape=wp.static(sizes[i + 1]), offset=start + wp.static(counts[i]))
            matrix = wp.tile_reshape(weights, shape=(wp.static(sizes[i + 1]), wp.static(sizes[i])))
            column = wp.tile_reshape(bias, shape=(wp.static(sizes[i + 1]), 1))
            z = wp.tile_broadcast(column, shape=(wp.static(sizes[i + 1]), block_dim)) * 1.0
            if wp.static(half):
                wp.tile_matmul(wp.tile_astype(matrix, wp.float16), wp.tile_astype(h, wp.float16), z)
            else:
                # h * 1.0 is a tile in shared memory; h itself must not become one: the adjoint of wp.tile (Warp 1.19)
                # then takes its values for its gradients
                wp.tile_matmul(matrix, h * 1.0, z)
            if wp.static(i == last):
                h = wp.tile_map(output, z)
            else:
                h = wp.tile_map(hidden, z)
        return vec_out(float_out(wp.untile(h)))

    @wp.func
    def tiled_mlp(params: Parameters, x: vec_in) -> vec_out:
        # as arguments, because a module's hash (Warp 1.19) does not see functions that go straight to a builtin
        return layers(params, x, hidden, output)

    return tiled_mlp
