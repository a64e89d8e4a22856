"""`Decoder`: a neural texture's state on a device, for kernels and for whole pictures."""

from collections.abc import Callable
from functools import cached_property

import numpy as np
import warp as wp

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.texture.layout import Layout
from warp_neural.kernels.texture.spec import Grid
from warp_neural.kernels.texture.texel import make_decode_kernel, make_params_type, make_texel
from warp_neural.nn.mlp import MLP
from warp_neural.texture.initial import make_network
from warp_neural.texture.levels import make_levels
from warp_neural.texture.rows import RowDecoder
from warp_neural.texture.state import TextureState
from warp_neural.texture.tensor_cores import TensorDecoder, can_decode

BLOCK = 256


class Decoder:
    """params: for kernels, of type `Params`. texel: `(params, i, j, mip) -> vector` of the channels that the network
    has, see `make_texel`."""

    def __init__(self, state: TextureState, device: wp.DeviceLike = None):
        self.spec, self.device = state.spec, find_device(device)
        self.net = network_of(state, self.device)
        self._put(state)

    def _put(self, state: TextureState) -> None:
        """All that kernels read."""
        self.Params = make_params_type(self.net.Params)
        params = self.params = self.Params()
        params.network, params.levels = self.net.params, make_levels(state.spec, self.device)
        packed = [pack(grid, x) for level in state.latents for grid, x in zip(state.spec.grids, level, strict=True)]
        starts = np.cumsum([0, *map(len, packed[:-1])]).reshape(state.spec.mips, -1)
        params.latents = wp.array(np.concatenate(packed), dtype=wp.uint32, device=self.device)
        params.starts = wp.array(starts, dtype=int, device=self.device)
        params.kernels = wp.array(kernels_of(state), dtype=float, device=self.device)

    @cached_property
    def texel(self) -> wp.Function:
        return make_texel(self.spec, self.net.func, self.Params)

    @cached_property
    def tensor(self) -> TensorDecoder:
        return TensorDecoder(self.spec, self.Params, self.params, self.net)

    @cached_property
    def rows(self) -> RowDecoder:
        return RowDecoder(self.spec, self.Params, self.params, self.net)

    def decode(self, mip: int = 0, rectangle: tuple[int, int, int, int] | None = None) -> np.ndarray:
        """The channels of the network, float32 [height, width, channels]. rectangle: left, top, width, height.

        On CUDA from sm_80 on by tensor cores, with features and vectors between layers of float16."""
        _, _, w, h = self._inside(mip, rectangle)
        values = wp.empty((h, w, self.spec.channels), dtype=float, device=self.device)
        self.decode_to(values, mip, rectangle)
        return values.numpy()

    def decode_to(self, values: wp.array, mip: int = 0, rectangle: tuple[int, int, int, int] | None = None) -> None:
        """See `Texture.decode_to`."""
        rectangle = self._inside(mip, rectangle)
        shape, (decode, dtypes) = (*rectangle[:1:-1], self.spec.channels), self._for_pictures()
        here = values.shape == shape and values.device == self.device and values.is_contiguous
        if not here or values.dtype not in dtypes:
            names = ", ".join(dtype.__name__ for dtype in dtypes)
            raise InputError(
                f"values {values.shape} of {values.dtype.__name__} on {values.device.alias}: results are {shape}, of "
                f"one of {names}, contiguous on {self.device.alias}; pass such an array"
            )
        decode(mip, rectangle, values)

    def _for_pictures(self) -> tuple[Callable, tuple[type, ...]]:
        """How whole pictures are decoded, and to what."""
        if can_decode(self.spec, self.device):
            return self.tensor.decode, (wp.float32, wp.float16, wp.uint8)
        return self.decode_alone if self.device.is_cuda else self.rows.decode, (wp.float32,)

    def decode_alone(self, mip: int, rectangle: tuple[int, int, int, int], values: wp.array) -> None:
        """A thread each texel, in float32, on any device."""
        left, top, w, h = rectangle
        kernel = make_decode_kernel(self.texel, self.Params)
        inputs = [self.params, mip, top, left, values]
        wp.launch(kernel, (h, w), inputs, device=self.device, block_dim=BLOCK, record_tape=False)

    def _inside(self, mip: int, rectangle: tuple[int, int, int, int] | None) -> tuple[int, int, int, int]:
        if not 0 <= mip < self.spec.mips:
            raise InputError(f"mip {mip}: the texture has levels 0 to {self.spec.mips - 1}; choose one of these")
        height, width = self.spec.size(mip)
        left, top, w, h = rectangle or (0, 0, width, height)
        if not (0 <= left < left + w <= width and 0 <= top < top + h <= height):
            raise InputError(f"rectangle {rectangle}: mip {mip} is {width} x {height}; choose one inside")
        return left, top, w, h


def pack(grid: Grid, latents: np.ndarray) -> np.ndarray:
    """int8 latents in the words of `make_latent`."""
    codes = (latents.ravel() > 0 if grid.bits == 1 else latents.ravel().astype(np.int16) + grid.limit).astype(np.uint32)
    each = 32 // grid.resident_bits
    rows = np.pad(codes, (0, -len(codes) % each)).reshape(-1, each)
    return np.bitwise_or.reduce(rows << np.arange(each, dtype=np.uint32) * np.uint32(grid.resident_bits), axis=1)


def network_of(state: TextureState, device: wp.Device) -> MLP:
    net = make_network(state.spec, device)
    net.weights = [state.tensors[f"weights_{l}"].values for l in range(len(state.spec.layers))]
    net.biases = [state.tensors[f"biases_{l}"].values for l in range(len(state.spec.layers))]
    return net


def kernels_of(state: TextureState) -> np.ndarray:
    """In the order of `Layout`, channels last."""
    layout = Layout(state.spec)
    flat = np.zeros(layout.size, np.float32)
    for name, place in layout.places.items():
        if name in state.tensors:
            flat[place.start : place.end] = np.moveaxis(state.tensors[name].values, 0, -1).ravel()
    return flat
