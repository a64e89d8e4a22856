"""How far a network is from the terms."""

from functools import cache

import numpy as np
import warp as wp

import warp_neural as wn
from warp_neural.samples.shader_training.disney import draw


@cache
def make_error_kernel(func: wp.Function) -> wp.Kernel:
    """dim (samples): errors of `func(params, x)`."""
    params_type = func.input_types["params"]  # of its shape alone

    @wp.kernel(module="unique", enable_backward=False)
    def error_kernel(params: params_type, seed: wp.uint64, errors: wp.array[float], by_term: wp.array[wp.vec4]):
        i = wp.tid()
        x, terms = draw(i, wn.random.stream(seed, 0, i, wn.random.HELD_OUT))
        y = func(params, x)
        error = wp.vec4()
        relative = wp.vec4()
        for k in range(4):
            error[k] = y[k] - terms[k]
            relative[k] = wp.abs(error[k]) / (wp.abs(terms[k]) + 0.01)
        errors[i] = wp.length(error) / wp.length(terms)
        by_term[i] = relative

    return error_kernel


def evaluate(net: wn.MLP, *, samples: int = 1 << 20, seed: int = 0) -> dict[str, float | list[float]]:
    """Errors over `samples` inputs drawn as in training, but from streams that training does not have:
    ||prediction - terms|| / ||terms|| of all four terms together, mean and median, and of each term the mean of
    |error| / (|term| + 0.01).
    """
    errors = wp.empty(samples, dtype=float, device=net.device)
    by_term = wp.empty(samples, dtype=wp.vec4, device=net.device)
    inputs = [net.params, seed, errors, by_term]
    wp.launch(make_error_kernel(net.func), dim=samples, inputs=inputs, device=net.device, record_tape=False)
    values = errors.numpy()
    return {
        "relative_error": float(values.mean(dtype=np.float64)),
        "relative_error_median": float(np.median(values)),
        "relative_error_per_term": by_term.numpy().mean(axis=0, dtype=np.float64).tolist(),
    }
