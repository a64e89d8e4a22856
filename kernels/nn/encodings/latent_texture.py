"""A trainable texture as an encoding: the bilinear value of its texels at the input."""

from dataclasses import dataclass

from warp_neural.kernels.errors import require_whole
from warp_neural.kernels.nn.encodings.base import (
    Encoding,
    add_entry,
    number,
    read_entry,
    require_inputs,
    require_range,
    require_sizes,
)


@dataclass(frozen=True)
class LatentTexture(Encoding):
    """`channels` bilinear values of a texture at (u, v): the course's step 5. u goes along the width.

    Parameters are the texels [height, width, channels], row 0 at v = 0. Clamped, texel centres lie at i / (size - 1),
    so that the outermost ones are at 0 and 1, and inputs outside [0, 1] read the nearest edge. With `wrap`, they lie at
    (i + 0.5) / size and the texture repeats with period 1.
    """

    width: int
    height: int
    channels: int = 4
    wrap: bool = False
    initial: tuple[float, float] = (0.0, 1.0)

    def __post_init__(self):
        require_sizes(self, "width", "height", "channels")
        require_whole("LatentTexture: width * height * channels", self.width * self.height * self.channels)
        require_range(self)

    @property
    def sparse(self) -> bool:
        return False  # texels are few; those that a batch has missed learn faster with momentum

    @property
    def lanes(self) -> int:
        return 4  # one for each texel

    def n_out(self, n_in: int) -> int:
        require_inputs(self, n_in, 2, 2)  # u and v
        return self.channels

    def n_parameters(self, n_in: int) -> int:
        return self.width * self.height * self.channels

    def encode_text(self, n_in: int, aligned: int) -> str:
        return f"""for (int c = 0; c < {self.channels}; ++c) out[c] = 0.0f;
{self.for_each_corner(aligned, f"for (int c = 0; c < {self.channels}; ++c) out[c] += wx * wy * v[c];")}"""

    def adjoint_text(self, n_in: int, aligned: int) -> str:
        corner = f"""real dot = 0.0f;
for (int c = 0; c < {self.channels}; ++c) dot += d_out[c] * v[c];
d_in[0] += (i ? slope_x : -slope_x) * wy * dot;
d_in[1] += (j ? slope_y : -slope_y) * wx * dot;
if (grad) {{ {add_entry(self.channels, aligned, "grad + at", "wx * wy", "d_out")} }}"""
        return self.for_each_corner(aligned, corner)

    def for_each_corner(self, aligned: int, use: str) -> str:
        """`use` at the four texels around the input: of offset (i, j), weights `wx`, `wy` and values `v` from `at`."""
        texel = read_entry(self.channels, aligned, "p + at")
        return f"""{self.axis("x", "in[0]", self.width)}{self.axis("y", "in[1]", self.height)}
#pragma unroll
for (int k = 0; k < 4 / lanes; ++k) {{
const int corner = k * lanes | lane, i = corner & 1, j = corner >> 1;
const wp::int64 at = (wp::int64(j ? y1 : y0) * {self.width} + (i ? x1 : x0)) * {self.channels};
const real wx = i ? offset_x : 1.0f - offset_x, wy = j ? offset_y : 1.0f - offset_y;
{texel}{use}
}}
"""

    def axis(self, a: str, value: str, size: int) -> str:
        """Neighbours `x0`, `x1`, the second's weight `offset_x`, its derivative `slope_x`. NaN reads some texel."""
        if self.wrap:
            return f"""const real at_{a} = ({value} - wp::floor({value})) * {number(size)} - 0.5f;
const real low_{a} = wp::floor(at_{a});
const wp::int32 whole_{a} = static_cast<wp::int32>(low_{a});
const wp::int32 {a}0 = whole_{a} < 0 ? {size - 1} : wp::min(whole_{a}, {size - 1});
const wp::int32 {a}1 = {a}0 + 1 < {size} ? {a}0 + 1 : 0;
const real offset_{a} = at_{a} - low_{a}, slope_{a} = {number(size)};
"""
        last = size - 1
        return f"""const real at_{a} = {value} > 0.0f ? wp::min({value}, 1.0f) * {number(last)} : 0.0f;
const wp::int32 {a}0 = static_cast<wp::int32>(at_{a}), {a}1 = wp::min({a}0 + 1, {last});
const real offset_{a} = at_{a} - static_cast<real>({a}0);
const real slope_{a} = {value} >= 0.0f && {value} <= 1.0f ? {number(last)} : 0.0f;
"""
