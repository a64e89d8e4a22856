"""tiny-cuda-nn's parameter vector: its order, its padding, and its initial values."""

from dataclasses import dataclass

import numpy as np

from warp_neural.errors import InputError
from warp_neural.kernels.nn.spec import round_up
from warp_neural.torch.shape import Shape

PADDED = 16  # widths of tiny-cuda-nn's matrices are multiples of it
GRID_RANGE, VALUES, THREADS = 1e-4, 4, 128  # of its kernel that fills grids


@dataclass(frozen=True)
class Order:
    """Networks first, each matrix [out, in] row major, then encodings; no biases.

    Inputs and outputs of a network are padded to multiples of 16. Inputs of constant ones act as a bias: the first
    layer's bias here is the sum of their columns. Other columns and rows of padding have no effect and are left out.
    ones, front: whether inputs are padded with ones, and before the others.
    """

    shape: Shape
    ones: bool = True
    front: bool = False

    @property
    def matrices(self) -> list[tuple[int, int]]:
        """(rows, columns) of each, padded."""
        if not self.shape.spec:
            return []
        layers, last = self.shape.spec.layers, len(self.shape.spec.layers) - 1
        return [
            (round_up(n, PADDED) if i == last else n, round_up(k, PADDED) if i == 0 else k)
            for i, (k, n) in enumerate(layers)
        ]

    @property
    def n_network(self) -> int:
        return sum(rows * columns for rows, columns in self.matrices)

    @property
    def n_parameters(self) -> int:
        return self.n_network + self.shape.n_parameters - self.shape.encoding_start

    def take(self, vector: np.ndarray) -> np.ndarray:
        """Of tiny-cuda-nn's vector [n_parameters] the parameters in the order of `Shape`, float32."""
        if vector.shape != (self.n_parameters,):
            raise InputError(
                f"parameters {list(vector.shape)}: expected [{self.n_parameters}], as tiny-cuda-nn has them"
            )
        result, start = np.zeros(self.shape.n_parameters, np.float32), 0
        for layer, (rows, columns) in enumerate(self.matrices):
            matrix = vector[start : start + rows * columns].astype(np.float32).reshape(rows, columns)
            weights, bias, inside, fill = self._places(result, layer, columns)
            weights[...] = matrix[: len(weights), inside]
            if layer == 0 and self.ones:
                bias[...] = matrix[: len(weights), fill].sum(axis=1)
            start += rows * columns
        result[self.shape.encoding_start :] = vector[start:]
        return result

    def give(self, parameters: np.ndarray) -> np.ndarray:
        """tiny-cuda-nn's vector of parameters in the order of `Shape`; padding is 0, and a bias in one column of it."""
        result, start = np.zeros(self.n_parameters, np.float32), 0
        for layer, (rows, columns) in enumerate(self.matrices):
            matrix = result[start : start + rows * columns].reshape(rows, columns)
            weights, bias, inside, fill = self._places(parameters, layer, columns)
            matrix[: len(weights), inside] = weights
            if layer == 0 and self.ones and fill.stop > fill.start:
                matrix[: len(weights), fill.start] = bias
            elif bias.any():
                raise InputError(f"the biases of layer {layer} are not 0; tiny-cuda-nn's networks have none there")
            start += rows * columns
        result[start:] = parameters[self.shape.encoding_start :]
        return result

    def _places(self, parameters: np.ndarray, layer: int, columns: int) -> tuple[np.ndarray, np.ndarray, slice, slice]:
        """Weights and biases of a layer, both views; which columns of tiny-cuda-nn's matrix are inputs, which fill."""
        (k, n), at = self.shape.spec.layers[layer], self.shape.spec.offsets[layer]
        weights, bias = parameters[at : at + n * k].reshape(n, k), parameters[at + n * k : at + n * k + n]
        if self.front:
            return weights, bias, slice(columns - k, columns), slice(0, columns - k)
        return weights, bias, slice(0, k), slice(k, columns)

    def initial(self, seed: int) -> np.ndarray:
        """tiny-cuda-nn's initial parameters, in its order, bit for bit (the grid's to 1e-11).

        Matrices are uniform within sqrt(6 / (rows + columns)), grids within 1e-4, of one stream of numbers.
        """
        n, n_grid = self.n_network, self.n_parameters - self.n_network
        stride = THREADS * -(-n_grid // (VALUES * THREADS))
        numbers = pcg32(seed, n + VALUES * stride)
        result, start = np.empty(self.n_parameters, np.float32), 0
        for rows, columns in self.matrices:
            end, bound = start + rows * columns, np.float32(np.sqrt(6 / (rows + columns)))
            result[start:end] = numbers[start:end] * (2 * bound) - bound
            start = end
        grid = numbers[n:].reshape(stride, VALUES).T.ravel()[:n_grid]  # thread t sets elements t, t + stride, ...
        result[n:] = grid * np.float32(2 * GRID_RANGE) - np.float32(GRID_RANGE)
        return result


def pcg32(seed: int, count: int) -> np.ndarray:
    """The first numbers of O'Neill's generator (2014), stream 1, as float32 in [0, 1)."""
    factor, increment, words = 6364136223846793005, 3, 2**64
    state = ((increment + seed) * factor + increment) % words
    powers = np.full(count + 1, factor, np.uint64)
    powers[0] = 1
    powers = np.cumprod(powers)  # wraps, as it should
    sums = np.cumsum(powers) - powers  # of the powers before each
    states = (powers * np.uint64(state) + sums * np.uint64(increment))[:count]
    mixed = (((states >> np.uint64(18)) ^ states) >> np.uint64(27)).astype(np.uint32)
    turn = (states >> np.uint64(59)).astype(np.uint32)
    bits = (mixed >> turn) | (mixed << (-turn & np.uint32(31)))
    return (bits >> np.uint32(9) | np.uint32(0x3F800000)).view(np.float32) - np.float32(1)
