"""An encoding in front of a network."""

from functools import cache

import warp as wp

from warp_neural.kernels.nn.spec import Parameters, select_network


@cache
def make_encoded(network: wp.Function, encode: wp.Function) -> wp.Function:
    params_type, vec_in = network.input_types["params"], encode.input_types["x"]

    @wp.func
    def encoded(params: params_type, x: vec_in):
        return network(params, encode(params, x))

    return encoded


@cache
def make_encode_kernel(encode: wp.Function) -> wp.Kernel:
    vec_in = encode.input_types["x"]

    @wp.kernel(module="unique", enable_backward=False)
    def encode_kernel(params: Parameters, x: wp.array3d[float], y: wp.array3d[float]):
        network, i = wp.tid()
        v = vec_in()
        for k in range(x.shape[2]):
            v[k] = x[network, i, k]
        e = encode(select_network(params, network), v)
        for k in range(y.shape[2]):
            y[network, i, k] = e[k]

    return encode_kernel
