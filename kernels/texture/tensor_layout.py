"""What the kernel of `tensor_cores` reads.

Tables [slab][texel of a block][phase of blocks][4 pairs of channels][4 taps][2]: float16 weights of the latents.
Vectors between layers are log2 e times what they are, for powers of 2 as they stand: weights of the first layer take
that in, those of the last take it out.

Weights [layer][16 inputs][16 outputs][lane][8]: float16, second operands of two products. Biases [mip][layer][padded
outputs]: float32, of the first layer with the level of detail.
"""

from dataclasses import dataclass
from functools import cached_property

from warp_neural.kernels.nn.spec import round_up
from warp_neural.kernels.texture.spec import TextureSpec


@dataclass(frozen=True)
class TensorLayout:
    """Where the kernel reads what: tables in units of 16 bytes, weights of 32 lanes of these, biases in pairs."""

    spec: TextureSpec

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
        inputs = (round_up(n, 16) for n in (8 * sum(self.slabs), *self.spec.hidden))
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
            ends.append(ends[-1] + n_in // 16 * (n_out // 16))
        return tuple(ends)

    @cached_property
    def biases(self) -> tuple[int, ...]:
        """Where each layer's begin, and the end of a level's."""
        return tuple(sum(self.sizes[1 : 1 + l]) // 2 for l in range(len(self.sizes)))
