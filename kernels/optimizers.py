"""One optimizer step over a flat float32 buffer: `tick_kernel`, once, then the update, one thread a parameter.

Step counter and rate live on the device, so a captured CUDA graph advances when it is replayed.
"""

import warp as wp


@wp.kernel(enable_backward=False)
def tick_kernel(rates: wp.array[float], beta1: float, beta2: float, step: wp.array[int], scalars: wp.array[float]):
    """step += 1; scalars = rate of this step, 1 / (1 - beta1^step), 1 / (1 - beta2^step). One thread."""
    now = step[0]
    step[0] = now + 1
    scalars[0] = rates[wp.min(now, rates.shape[0] - 1)]
    scalars[1] = 1.0 / (1.0 - wp.pow(beta1, float(now + 1)))
    scalars[2] = 1.0 / (1.0 - wp.pow(beta2, float(now + 1)))


@wp.kernel(enable_backward=False)
def adam_kernel(
    scalars: wp.array[float],
    beta1: float,
    beta2: float,
    eps: float,
    weight_decay: float,
    clear: bool,
    gradient: wp.array[float],
    first: wp.array[float],
    second: wp.array[float],
    parameters: wp.array[float],
):
    """Kingma and Ba 2015, algorithm 1; weight decay as Loshchilov and Hutter 2019, algorithm 2 (AdamW)."""
    i = wp.tid()
    g = gradient[i]
    m = beta1 * first[i] + (1.0 - beta1) * g
    v = beta2 * second[i] + (1.0 - beta2) * g * g
    first[i] = m
    second[i] = v
    p = parameters[i]
    change = m * scalars[1] / (wp.sqrt(v * scalars[2]) + eps)
    parameters[i] = p - scalars[0] * (change + weight_decay * p)
    if clear:
        gradient[i] = 0.0


@wp.kernel(enable_backward=False)
def sgd_kernel(
    scalars: wp.array[float],
    momentum: float,
    weight_decay: float,
    clear: bool,
    gradient: wp.array[float],
    velocity: wp.array[float],
    parameters: wp.array[float],
):
    """Heavy-ball momentum, undamped (PyTorch's form): velocity = momentum velocity + gradient; p -= rate velocity."""
    i = wp.tid()
    p = parameters[i]
    v = momentum * velocity[i] + gradient[i] + weight_decay * p
    velocity[i] = v
    parameters[i] = p - scalars[0] * v
    if clear:
        gradient[i] = 0.0
