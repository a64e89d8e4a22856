"""The arguments of a `Trainer`: what makes sense, and what a run must have in common with its checkpoint."""

from collections.abc import Sequence
from hashlib import sha256
from typing import Any

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.errors import LARGEST_SEED, is_finite, require, require_whole, single
from warp_neural.kernels.nn import losses
from warp_neural.kernels.nn.losses import Loss
from warp_neural.kernels.training.taped import data_type
from warp_neural.nn.mlp import MLP
from warp_neural.nn.names import require_object
from warp_neural.train import optim
from warp_neural.train.optim import SGD, Adam
from warp_neural.train.sample import check_sample

MAX_SAMPLES = 2**30  # of a step: indices have 32 bits, and go past the last sample by a stride


def check_arguments(net: Any, sample: Any, loss: Any, optimizer: Any, numbers: dict[str, Any]) -> None:
    """As `Trainer`. numbers: batches, average, loss_scale and seed. Raises `InputError` naming the argument."""
    require(isinstance(net, MLP), "net", net, "a wn.MLP")
    if net.count > 1:
        raise InputError(f"a network with count={net.count}: a Trainer trains one")
    check_sample(sample)
    require_object("loss", loss, (Loss,), losses, "one of wn.losses, or a Loss of your own")
    loss.gradient(net.n_out)  # its weights are as many
    if optimizer is not None:
        require_object("optimizer", optimizer, (Adam, SGD), optim, "Adam or SGD of wn.optim")
    average, scale = numbers["average"], numbers["loss_scale"]
    require_whole("batches", numbers["batches"])
    require_whole("seed", numbers["seed"], 0, LARGEST_SEED)
    decays = average is None or (is_finite(average) and 0 <= single(average) < 1)
    require(decays, "average", average, "the decay of an average, in [0, 1) of float32")
    scales = scale is None or (is_finite(scale) and scale > 0 and is_finite(1 / scale))
    require(scales, "loss_scale", scale, "a positive number of float32")


def batch_sizes(batch: int | Sequence[int], batches: int) -> np.ndarray:
    """Of the steps to come, int32 [n]."""
    try:
        sizes = np.atleast_1d(np.asarray(batch))
    except ValueError:
        sizes = np.empty(0)
    valid = sizes.ndim == 1 and sizes.size > 0 and all(isinstance(n, int | np.integer) and n >= 1 for n in sizes)
    require(valid, "batch", batch, "at least one sample, a whole number or several")
    samples = int(sizes.max()) * batches
    if samples > MAX_SAMPLES:
        raise InputError(f"batch * batches={samples}: expected at most MAX_SAMPLES={MAX_SAMPLES} samples a step")
    return sizes.astype(np.int32)


def check_data(sample: wp.Function, data: Any, device: wp.Device) -> None:
    """That `data` is what `sample` reads, on the network's device: Warp passes on the address of anything else."""
    expected = data_type(sample)
    if hasattr(expected, "key"):  # of a struct
        require(getattr(data, "_cls", None) is expected, "data", data, f"a {expected.key}, which sample reads")
        members = {f"data.{name}": getattr(data, name) for name in expected.vars}
    else:
        members = {"data": data}
        if hasattr(expected, "ndim"):  # of an array
            kind = f"an array of {expected.dtype.__name__} with {expected.ndim} dimensions, which sample reads"
            kinds = getattr(data, "dtype", None), getattr(data, "ndim", None)
            other = (kinds[1] or 0) >= expected.ndim  # NumPy's and others' arrays: Warp looks at them itself
            fits = kinds == (expected.dtype, expected.ndim) if isinstance(data, wp.array) else other
            name = f"array of {kinds[0].__name__}, {kinds[1]} dimensions" if isinstance(data, wp.array) else data
            require(fits, "data", name, kind)
    for name, value in members.items():
        if isinstance(value, wp.array) and value.size and value.device != device and not value.pinned:
            raise InputError(f"{name} is on {value.device.alias}, the network on {device.alias}; put them on one")


def digest(values: np.ndarray) -> str:
    """Equal for equal arrays."""
    return sha256(np.ascontiguousarray(values).tobytes()).hexdigest()
