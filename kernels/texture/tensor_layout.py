"""What the kernel of `tensor_cores` reads.

Tables [slab][texel of a block][phase of blocks][4 pairs of channels][4 taps][2]: float16 weights of the latents.
Vectors between layers are log2 e times what they are, for powers of 2 as they stand: weights of the first layer take
that in, those of the last take it out.

Weights [layer][16 inputs][16 outputs][lane][8]: float16, second operands of two products. Biases [mip][layer][pairs
of outputs][2][2]: float32, each pair twice, as sums have rows g and g + 8; of the first layer with the level of detail.

By int8 vectors are unsigned bytes q = 255 (v a + b), where v is a value; weights [layer][32 inputs][16 outputs][lane]
[16] signed bytes, of a lane the columns 2 t and 2 t + 1 of slabs 0 to 3, in steps of each output; biases [mip][layer]
[pairs of outputs][2][2] pairs of steps and of biases, less 1.5 * 2^23 steps. Behind the tables lie pairs of a and of b,
float16 [layer][pairs of inputs][2][2].
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from warp_neural.kernels.nn.spec import round_up
from warp_neural.kernels.texture.spec import TextureSpec

Precision = Literal["float16", "int8"]


@dataclass(frozen=True)
class TensorLayout:
    """Of what the kernel reads, in units of 16 bytes, of weights 32 lanes of these."""

    spec: TextureSpec
    precision: Precision = "float16"

    @property
    def step(self) -> int:
        """Inputs of a product."""
        return 32 if self.precision == "int8" else 16

    @property
    def fits(self) -> bool:
        """Whether the kernel is for such textures: at most 64 neurons a layer, and no cell smaller than a block."""
        return self.spec.grids[0].scale >= 2 and max(self.spec.hidden) <= 64

    @cached_property
    def slabs(self) -> tuple[int, ...]:
        """Of each grid."""
        return tuple(-(-grid.channels // 8) for grid in self.spec.grids)

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Inputs and outputs of all layers, padded."""
        inputs = (round_up(n, self.step) for n in (8 * sum(self.slabs), *self.spec.hidden))
        return *inputs, round_up(self.spec.channels, 16)

    @cached_property
    def tables(self) -> tuple[int, ...]:
        """Where each grid's begins, and the end of all."""
        ends = [0]
        for grid, slabs in zip(self.spec.grids, self.slabs, strict=True):
            ends.append(ends[-1] + slabs * 4 * grid.scale**2)
        return tuple(ends)

    @cached_property
    def weights(self) -> tuple[int, ...]:
        """Where each layer's begin, and the end of all."""
        ends = [0]
        for n_in, n_out in zip(self.sizes[:-1], self.sizes[1:], strict=True):
            ends.append(ends[-1] + n_in // self.step * (n_out // 16))
        return tuple(ends)

    @cached_property
    def biases(self) -> tuple[int, ...]:
        """Where each layer's begin, and the end of a level's."""
        return tuple(sum(self.sizes[1 : 1 + l]) // 2 for l in range(len(self.sizes)))
