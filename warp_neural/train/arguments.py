"""The arguments of a `Trainer`: what makes sense, and what a run must have in common with its checkpoint."""

from collections.abc import Sequence
from hashlib import sha256
from typing import Any

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.errors import is_finite, require, require_whole
from warp_neural.kernels.nn.losses import Loss
from warp_neural.nn.mlp import MLP
from warp_neural.train.optim import SGD, Adam


def check_arguments(net: Any, sample: Any, loss: Any, optimizer: Any, numbers: dict[str, Any]) -> None:
    """As `Trainer`. numbers: batches, average, loss_scale and seed. Raises `InputError` naming the argument."""
    require(isinstance(net, MLP), "net", net, "a wn.MLP")
    if net.count > 1:
        raise InputError(f"a network with count={net.count}: a Trainer trains one")
    arguments = len(sample.input_types) if isinstance(sample, wp.Function) else 0
    require(arguments in (2, 3), "sample", sample, "a @wp.func of (index, random) or (index, random, data)")
    require(isinstance(loss, Loss), "loss", loss, "one of wn.losses, or a Loss of your own")
    loss.gradient(net.n_out)  # its weights are as many
    require(optimizer is None or isinstance(optimizer, Adam | SGD), "optimizer", optimizer, "Adam or SGD of wn.optim")
    average, scale = numbers["average"], numbers["loss_scale"]
    require_whole("batches", numbers["batches"])
    require_whole("seed", numbers["seed"], 0)
    decays = average is None or (is_finite(average) and 0 <= average < 1)
    require(decays, "average", average, "the decay of an average, in [0, 1)")
    scales = scale is None or (is_finite(scale) and scale > 0)
    require(scales, "loss_scale", scale, "a positive number")


def batch_sizes(batch: int | Sequence[int]) -> np.ndarray:
    """Of the steps to come, [n]."""
    sizes = np.atleast_1d(np.asarray(batch))
    valid = sizes.ndim == 1 and sizes.size > 0 and np.issubdtype(sizes.dtype, np.integer) and sizes.min() >= 1
    require(valid, "batch", batch, "at least one sample, a whole number or several")
    return sizes


def digest(values: np.ndarray) -> str:
    """Equal for equal arrays."""
    return sha256(np.ascontiguousarray(values).tobytes()).hexdigest()
