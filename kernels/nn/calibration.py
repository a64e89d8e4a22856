"""Steps of INT8 networks, [networks, layers, 2] (of a layer's inputs, of its weights): the largest value / 127.

In turn: `start_kernel`, the kernels that raise steps to what they see, `finish_kernel`. Values that are not finite
count for nothing.
"""

from functools import cache

import warp as wp

from warp_neural.kernels.nn.activations import Activation

INPUTS, WEIGHTS = 0, 1  # the last index of steps


@wp.func
def raise_step(steps: wp.array3d[float], network: int, layer: int, which: int, value: float):
    step = wp.abs(value) / 127.0
    if wp.isfinite(step) and step > steps[network, layer, which]:  # most values are not: few reach the atomic
        wp.atomic_max(steps, network, layer, which, step)


@wp.kernel(enable_backward=False)
def start_kernel(steps: wp.array3d[float], which: int, keep: float):
    """dim (networks, layers). keep: what is left of the steps so far, 0 to forget them."""
    network, layer = wp.tid()
    steps[network, layer, which] = keep * steps[network, layer, which]


@wp.kernel(enable_backward=False)
def finish_kernel(steps: wp.array3d[float], which: int):
    """dim (networks, layers). Where all values were 0, any step will do."""
    network, layer = wp.tid()
    if steps[network, layer, which] <= 0.0:
        steps[network, layer, which] = 1.0 / 127.0


@wp.kernel(enable_backward=False)
def weights_kernel(master: wp.array[float], n_parameters: int, offset: int, layer: int, steps: wp.array3d[float]):
    """dim (networks, n_out * n_in): the weights of a layer, at `offset` in its network."""
    network, i = wp.tid()
    raise_step(steps, network, layer, wp.static(WEIGHTS), master[network * n_parameters + offset + i])


@cache
def make_take_kernel(dtype: type) -> wp.Kernel:
    """dim (networks, samples, n_in): the same samples, of `dtype`, for every network as float32."""

    @wp.kernel(module="unique", enable_backward=False)
    def take_kernel(x: wp.array2d[dtype], y: wp.array3d[float]):
        network, i, k = wp.tid()
        y[network, i, k] = float(x[i, k])

    return take_kernel


@cache
def make_layer_kernel(activation: Activation) -> wp.Kernel:
    """One layer of many networks, for many samples, without rounding; raises the step of its inputs x.

    dim (networks, samples, n_out). The layer's parameters lie at `offset` in its network's.
    """
    value = activation.func

    @wp.kernel(module="unique", enable_backward=False)
    def layer_kernel(
        master: wp.array[float],
        n_parameters: int,
        offset: int,
        layer: int,
        x: wp.array3d[float],
        steps: wp.array3d[float],
        y: wp.array3d[float],
    ):
        network, sample, n = wp.tid()
        n_in, n_out = x.shape[2], y.shape[2]
        weights = network * n_parameters + offset
        total = master[weights + n_out * n_in + n]
        for k in range(n_in):
            total += master[weights + n * n_in + k] * x[network, sample, k]
            if n == 0:
                raise_step(steps, network, layer, wp.static(INPUTS), x[network, sample, k])
        y[network, sample, n] = value(total)

    return layer_kernel
