"""What a neural texture's training starts from."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warp_neural.kernels.nn.activations import elu
from warp_neural.kernels.texture.layout import BILINEAR, Layout
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.nn.mlp import MLP

SPREAD = 0.3  # of trained kernels around bilinear interpolation, relative to `BILINEAR`
LAST = 0.3  # of the last layer's weights, relative to He's


def initial_network(spec: TextureSpec, device: wp.Device, random: np.random.Generator) -> MLP:
    """He et al. 2015, eq. 10."""
    net = make_network(spec, device)
    gains = [np.sqrt(2 / n_in) for _, n_in in spec.layers]
    gains[-1] *= LAST
    net.weights = [gain * random.standard_normal(n, np.float32) for gain, n in zip(gains, spec.layers, strict=True)]
    return net


def make_network(spec: TextureSpec, device: wp.Device) -> MLP:
    width, depth = spec.hidden[0], len(spec.hidden)
    return MLP(spec.n_in, spec.channels, width, depth, activation=elu, device=device)


def set_means(net: MLP, levels: Sequence[np.ndarray]) -> None:
    """The last layer's biases: the means of the channels of the finest level, without NaN."""
    finest, biases = levels[0][..., : net.n_out], net.biases
    known = ~np.isnan(finest)
    total = finest.sum((0, 1), where=known, dtype=np.float64)
    biases[-1] = (total / np.maximum(known.sum((0, 1)), 1)).astype(np.float32)
    net.biases = biases


def initial_kernels(layout: Layout, random: np.random.Generator) -> np.ndarray:
    """Kernels and scales, in the order of the layout."""
    values = np.zeros(layout.size, np.float32)
    for name, place in layout.places.items():
        if name.startswith("kernel"):
            grid = layout.spec.grids[int(name.split("_")[1])]
            values[place.start : place.end] = _kernel(grid, place.shape, random).ravel()
    return values


def _kernel(grid: Grid, shape: tuple[int, ...], random: np.random.Generator) -> np.ndarray:
    f = (np.arange(grid.scale) + 0.5) / grid.scale
    line = np.stack([1 - f, f], -1)  # [scale, 2]
    noise = SPREAD * random.standard_normal(shape)
    if grid.kernel == "learned":
        bilinear = np.einsum("ya,xb->yxab", line, line).reshape(grid.scale, grid.scale, 4, 1)
        return BILINEAR * (bilinear + noise)
    return np.sqrt(BILINEAR) * (line[..., None] + noise)
