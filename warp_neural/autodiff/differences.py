"""`check`: the gradients of a kernel against finite differences."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import warp as wp

from warp_neural.errors import InputError

STEPS = 10.0 ** np.arange(-1.0, -4.1, -0.5)  # relative to the size of an argument's values
STEPS_FLOAT64 = 10.0 ** np.arange(-1.0, -6.1, -0.5)


def check(
    kernel: wp.Kernel,
    dim: int | Sequence[int],
    inputs: Sequence,
    outputs: Sequence,
    *,
    update: Callable[[], Any] | None = None,
    tolerance: float = 0.02,
    seed: int = 0,
    device: wp.DeviceLike = None,
) -> float:
    """The largest relative error of the gradients that `wp.Tape` gives for a kernel; raises above `tolerance`.

        wn.autodiff.check(loss_kernel, n, [net.params, x, trips], [loss], update=net.pack)

    Arguments as for `wp.launch`. Each array of floats in `inputs` that requires a gradient, in structs too, is moved
    along one random direction, by a third of its size or less, and the change of the randomly weighted sum of all
    `outputs` compared with what its gradient says. The step is the one around which the differences agree best, the
    error relative to the length of the gradient: 1e-5 to 1e-3 in float32, more in float16 and where there are kinks.

    `update` is called whenever inputs have changed: `net.pack`, where parameters of a network are among them. A kernel
    that draws random numbers must draw the same ones each time. Values and gradients are left as they were.

    Raises `ArithmeticError`, one line that names the arguments whose gradients are wrong.
    """
    names = [argument.label for argument in kernel.adj.args]
    moved = {name: array for name, array in _arrays(names, inputs) if array.requires_grad}
    results = [array for _, array in _arrays(names[len(inputs) :], outputs)]
    if not moved or not results:
        raise InputError(
            f"check of {kernel.key}: {len(moved)} arrays of floats with requires_grad=True in inputs, {len(results)} "
            "arrays of floats in outputs; expected one or more of each"
        )
    start = [array.numpy().copy() for array in results]

    def launch() -> list[np.ndarray]:
        if update:
            update()
        for array, values in zip(results, start, strict=True):
            array.assign(values)  # for kernels that add to them
        wp.launch(kernel, dim, inputs, outputs, device=device or results[0].device)
        return [array.numpy().astype(np.float64) for array in results]

    with _unchanged([*moved.values(), *results], update):
        rng = np.random.default_rng(seed)
        weights = [rng.normal(size=values.shape) / _size(values) for values in launch()]  # so that none hides another
        gradients = _gradients(launch, list(moved.values()), results, weights)
        found = {}
        for (name, array), gradient in zip(moved.items(), gradients, strict=True):
            found[name] = _compare(array, gradient, lambda: sum(map(np.vdot, weights, launch())), rng)
    faults = [f"{name}: {text}" for name, (error, text) in found.items() if not error <= tolerance]
    if faults:
        raise ArithmeticError(f"wrong gradients of {kernel.key}: {'; '.join(faults)}")
    return max(error for error, _ in found.values())


@contextmanager
def _unchanged(arrays: list[wp.array], update: Callable[[], Any] | None) -> Iterator[None]:
    """Values and gradients are afterwards what they were."""
    kept = [(array.numpy().copy(), array.grad and array.grad.numpy().copy()) for array in arrays]
    try:
        yield
    finally:
        for array, (values, gradient) in zip(arrays, kept, strict=True):
            array.assign(values)
            if gradient is None:
                array.requires_grad = False
            else:
                array.grad.assign(gradient)
        if update:
            update()


def _arrays(names: Sequence[str], values: Sequence) -> Iterator[tuple[str, wp.array]]:
    """Arrays of floats with their names; those in structs as `struct.field`."""
    for name, value in zip(names, values, strict=False):
        if wp.types.is_array(value):
            if value.size and wp.types.type_is_float(getattr(value.dtype, "_wp_scalar_type_", value.dtype)):
                yield name, value
        elif hasattr(value, "_cls"):
            fields = list(value._cls.vars)
            yield from _arrays([f"{name}.{field}" for field in fields], [getattr(value, field) for field in fields])


def _size(values: np.ndarray) -> float:
    """Root mean square; 1 for zeros."""
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64)))) or 1.0


def _gradients(launch: Callable, moved: list[wp.array], results: list[wp.array], weights: list) -> list[np.ndarray]:
    """Of the weighted sum of `results` with respect to each of `moved`, by a tape."""
    for array in [*moved, *results]:
        array.requires_grad = True
        array.grad.zero_()
    with wp.Tape() as tape:
        launch()
    for array, weight in zip(results, weights, strict=True):
        array.grad.assign(weight)
    tape.backward()
    return [array.grad.numpy().astype(np.float64) for array in moved]


def _compare(array: wp.array, gradient: np.ndarray, total: Callable, rng: np.random.Generator) -> tuple[float, str]:
    """The relative error of a gradient, and what it says beside what the differences of `total` say."""
    values = array.numpy().copy()
    direction = rng.normal(size=values.shape) * _size(values)
    slopes = []
    for step in STEPS_FLOAT64 if values.dtype == np.float64 else STEPS:
        sums, ends = [], []
        for sign in (-1, 1):
            ends.append((values + sign * step * direction).astype(values.dtype))  # rounded: both slopes are of this
            array.assign(ends[-1])
            sums.append(total())
        change = np.subtract(ends[1], ends[0], dtype=np.float64)
        slopes.append([np.vdot(gradient, change) / (2 * step), (sums[1] - sums[0]) / (2 * step)])
    array.assign(values)
    slopes = np.array(slopes)
    spreads = np.nan_to_num(np.ptp(np.lib.stride_tricks.sliding_window_view(slopes[:, 1], 3), axis=1), nan=np.inf)
    best = int(np.argmin(spreads))
    says, differences = slopes[best + 1]
    size = max(np.linalg.norm(gradient * direction), abs(differences))
    text = f"{says:.5g} along a random direction, {differences:.5g} ± {spreads[best]:.1g} by finite differences"
    return (abs(says - differences) / size if size else 0.0), text
