"""One optimizer step over a flat float32 buffer: `tick_kernel`, once, then the update, one thread a parameter.

Step counter and rate live on the device, so a captured CUDA graph advances when it is replayed.
"""

from functools import cache

import warp as wp


@wp.kernel(enable_backward=False)
def tick_kernel(rates: wp.array[float], beta1: float, beta2: float, step: wp.array[int], scalars: wp.array[float]):
    """step += 1; scalars = rate of this step, 1 / (1 - beta1^step), 1 / (1 - beta2^step). One thread."""
    now = step[0]
    step[0] = now + 1
    scalars[0] = rates[wp.min(now, rates.shape[0] - 1)]
    scalars[1] = 1.0 / (1.0 - wp.pow(beta1, float(now + 1)))
    scalars[2] = 1.0 / (1.0 - wp.pow(beta2, float(now + 1)))


@wp.func
def adam(g: float, state: wp.vec3, rate: float, corrections: wp.vec2, settings: wp.vec4) -> wp.vec3:
    """state: the parameter and both moments, before and after a step; g: gradient. settings: beta1, beta2, eps, decay.

    Kingma and Ba 2015, algorithm 1; weight decay as Loshchilov and Hutter 2019, algorithm 2 (AdamW).
    """
    m = settings[0] * state[1] + (1.0 - settings[0]) * g
    v = settings[1] * state[2] + (1.0 - settings[1]) * g * g
    change = m * corrections[0] / (wp.sqrt(v * corrections[1]) + settings[2])
    return wp.vec3(state[0] - rate * (change + settings[3] * state[0]), m, v)


@wp.func
def sgd(g: float, state: wp.vec3, rate: float, corrections: wp.vec2, settings: wp.vec4) -> wp.vec3:
    """state: the parameter and its velocity. settings: momentum, -, -, weight decay.

    Heavy-ball momentum, undamped (PyTorch's form): velocity = momentum velocity + gradient.
    """
    v = settings[0] * state[1] + g + settings[3] * state[0]
    return wp.vec3(state[0] - rate * v, v, 0.0)


@cache
def make_update_kernel(update: wp.Function) -> wp.Kernel:
    """One step of `adam` or `sgd` for every parameter; `scalars` are those of `tick_kernel`."""

    @wp.kernel(module="unique", enable_backward=False)
    def update_kernel(
        scalars: wp.array[float],
        settings: wp.vec4,
        clear: bool,
        gradient: wp.array[float],
        first: wp.array[float],
        second: wp.array[float],
        parameters: wp.array[float],
    ):
        i = wp.tid()
        state = wp.vec3(parameters[i], first[i], second[i])
        state = update(gradient[i], state, scalars[0], wp.vec2(scalars[1], scalars[2]), settings)
        parameters[i] = state[0]
        second[i] = state[2]
        first[i] = state[1]  # the same array as `second` for `sgd`
        if clear:
            gradient[i] = 0.0

    return update_kernel
