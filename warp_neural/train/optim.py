"""Optimizers and learning-rate schedules for float32 parameters on one device.

`warp.optim.Adam` and `SGD` serve plain scripts. They are not used here because they launch once per array, keep the
step count and rate on the host (a replayed CUDA graph would not advance), and know neither vec2, vec4 nor matrices.
"""

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.errors import is_finite, require, require_whole, single
from warp_neural.kernels.nn.optimizers import adam, make_update_kernel, sgd, tick_kernel

__all__ = ["SGD", "Adam", "Parameters", "cosine", "exponential", "linear"]


class Parameters:
    """Named arrays of any float32 dtype laid out in one flat buffer, `flat`; gradients likewise in `flat.grad`.

    `Parameters(albedo=wp.array(..., dtype=wp.vec3), roughness=...)` copies the arrays. `parameters["albedo"]` is a
    view with the same dtype and shape, its `.grad` a view of the gradients: write to either, launch with either.
    """

    def __init__(self, **arrays: wp.array) -> None:
        require(len(arrays) > 0, "Parameters: arrays", arrays, "at least one, by name")
        for name, array in arrays.items():
            require(isinstance(array, wp.array), f"Parameters: {name}", type(array).__name__, "a Warp array")
        device = next(iter(arrays.values())).device
        if any(array.device != device for array in arrays.values()):
            raise InputError("the parameters lie on several devices; put them on one")
        scalars = {name: _scalars(array) for name, array in arrays.items()}
        total = sum(array.size for array in scalars.values())
        self.flat = wp.zeros(total, dtype=wp.float32, device=device, requires_grad=True)
        self._views: dict[str, wp.array] = {}
        start = 0
        for name, array in arrays.items():
            end = start + scalars[name].size
            view = _view(self.flat, start, end, array)
            view.grad = _view(self.flat.grad, start, end, array)
            wp.copy(view, array)
            self._views[name] = view
            start = end

    def __getitem__(self, name: str) -> wp.array:
        return self._views[name]

    def numpy(self) -> dict[str, np.ndarray]:
        """A copy of every array on the host."""
        return {name: view.numpy().copy() for name, view in self._views.items()}

    def __repr__(self) -> str:
        arrays = (f"{name}={view.dtype.__name__} {list(view.shape)}" for name, view in self._views.items())
        return f"Parameters({', '.join(arrays)}, {self.flat.device.alias})"


def linear(start: float, end: float, steps: int) -> np.ndarray:
    """Rates for `steps` steps on a line from `start` towards `end`, then `end`. (Constant: pass the number itself.)"""
    _check_schedule(start, end, steps)
    return _rates(start + (end - start) * np.arange(steps + 1) / steps)


def cosine(start: float, end: float, steps: int) -> np.ndarray:
    """Half a cosine from `start` down to `end` over `steps` steps, then `end` (Loshchilov and Hutter 2017, eq. 5)."""
    _check_schedule(start, end, steps)
    return _rates(end + (start - end) * 0.5 * (1 + np.cos(np.pi * np.arange(steps + 1) / steps)))


def exponential(start: float, end: float, steps: int) -> np.ndarray:
    """A constant factor a step from `start` to `end` (both positive) over `steps` steps, then `end`."""
    _check_schedule(start, end, steps)
    require(start > 0 and end > 0, "start, end", (start, end), "positive rates, or another schedule")
    return _rates(start * (end / start) ** (np.arange(steps + 1) / steps))


def _check_schedule(start: float, end: float, steps: int) -> None:
    require_whole("steps", steps)
    for name, value in (("start", start), ("end", end)):
        require(is_finite(value) and value >= 0, name, value, "a rate, finite and not negative")


class _Optimizer:
    """What SGD and Adam share: the flat view of the parameters, the rates and the step counter on the device."""

    update: wp.Function
    moments: int

    def __init__(self, parameters: wp.array | Parameters | None, lr, options: dict[str, float], clear: bool) -> None:
        for name, value in options.items():
            valid, expected = is_finite(value) and value >= 0, "a finite number, not negative"
            if name in ("beta1", "beta2", "momentum"):
                valid, expected = valid and single(value) < 1, "a number in [0, 1) of float32"
            if name == "eps":
                valid, expected = valid and single(value) > 0, "a positive number of float32"
            require(valid, f"{type(self).__name__}: {name}", value, expected)
        self.lr, self.clear, self.options = _rates(lr), clear, options
        *others, decay = options.values()
        self.settings = wp.vec4(*[*others, 0.0, 0.0][:3], decay)
        if parameters is not None:
            self.bind(parameters)

    def __repr__(self) -> str:
        rates = np.atleast_1d(self.lr)
        lr = f"{rates[0]:g}" if len(rates) == 1 else f"{rates[0]:g} to {rates[-1]:g} in {len(rates)} steps"
        options = "".join(f", {name}={value:g}" for name, value in self.options.items())
        return f"{type(self).__name__}(lr={lr}{options})"

    def bind(self, parameters: wp.array | Parameters) -> None:
        """Start on these parameters; a `Trainer` does this itself."""
        array = parameters.flat if isinstance(parameters, Parameters) else parameters
        require(isinstance(array, wp.array), "parameters", type(array).__name__, "a Warp array, or Parameters")
        if array.grad is None:
            raise InputError("the parameters have no gradient; make them with requires_grad=True")
        self.values, self.gradient = _scalars(array), _scalars(array.grad)
        self.device = array.device
        self.rates = wp.array(np.atleast_1d(self.lr), dtype=wp.float32, device=self.device)
        self.steps = wp.zeros(1, dtype=wp.int32, device=self.device)
        """[1], the steps taken so far; kernels may read it, e.g. as part of a seed"""
        self.first = wp.zeros_like(self.gradient)
        self.second = wp.zeros_like(self.gradient) if self.moments == 2 else self.first
        self._scalars = wp.zeros(3, dtype=wp.float32, device=self.device)

    def step(self) -> None:
        """Update the parameters from their gradients."""
        tick = [self.rates, self.settings[0], self.settings[1], self.steps, self._scalars]
        wp.launch(tick_kernel, dim=1, inputs=tick, device=self.device, record_tape=False)
        inputs = [self._scalars, self.settings, self.clear, self.gradient, self.first, self.second, self.values]
        kernel, dim = make_update_kernel(self.update), self.values.size
        wp.launch(kernel, dim, inputs, device=self.device, record_tape=False)


class Adam(_Optimizer):
    """Adam; with `weight_decay` AdamW. `step()` is two launches for all parameters and may be captured in a graph.

    Parameters: one contiguous array of any float32 dtype with a gradient, e.g. a network's, or `Parameters`; none for
    a `Trainer`, which binds its own. `lr` is a number or the rates of the steps to come, the last one staying. `clear`
    zeroes the gradients after use, for kernels that add to them.
    """

    update, moments = adam, 2

    def __init__(
        self,
        parameters: wp.array | Parameters | None = None,
        *,
        lr: float | np.ndarray = 1e-3,
        beta1: float = 0.9,
        beta2: float = 0.999,
        eps: float = 1e-8,
        weight_decay: float = 0.0,
        clear: bool = False,
    ) -> None:
        options = {"beta1": beta1, "beta2": beta2, "eps": eps, "weight_decay": weight_decay}
        super().__init__(parameters, lr, options, clear)


class SGD(_Optimizer):
    """Gradient descent, with heavy-ball `momentum` if not 0. Parameters, `lr` and `clear` as for `Adam`."""

    update, moments = sgd, 1

    def __init__(
        self,
        parameters: wp.array | Parameters | None = None,
        *,
        lr: float | np.ndarray = 1e-3,
        momentum: float = 0.0,
        weight_decay: float = 0.0,
        clear: bool = False,
    ) -> None:
        super().__init__(parameters, lr, {"momentum": momentum, "weight_decay": weight_decay}, clear)


def _rates(values: float | np.ndarray) -> np.ndarray:
    try:
        rates = np.array(values)
    except ValueError:
        rates = np.empty(0)
    with np.errstate(over="ignore"):  # too large is infinite, and refused
        rates = rates.astype(np.float32) if rates.dtype.kind in "iuf" else np.empty(0)
    valid = rates.ndim <= 1 and rates.size > 0 and np.isfinite(rates).all() and (rates >= 0).all()
    require(valid, "lr", values, "a rate, or those of the steps to come, finite and not negative")
    rates.flags.writeable = False
    return rates


def _scalars(array: wp.array) -> wp.array:
    """The same memory as a flat float32 array."""
    if getattr(array.dtype, "_wp_scalar_type_", array.dtype) is not wp.float32 or not array.is_contiguous:
        raise InputError(f"parameters must be contiguous float32 arrays, got {array.dtype} {array.shape}")
    return (array if array.dtype is wp.float32 else array.view(wp.float32)).flatten()


def _view(flat: wp.array, start: int, end: int, like: wp.array) -> wp.array:
    """`flat[start:end]` with the dtype and shape of `like`, sharing memory."""
    part = flat[start:end].reshape((*like.shape, *like.dtype._shape_) if hasattr(like.dtype, "_shape_") else like.shape)
    return part if like.dtype is wp.float32 else part.view(like.dtype)
