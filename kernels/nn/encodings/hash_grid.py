"""The multiresolution hash grid: trainable features at the vertices of grids from coarse to fine."""

from ctypes import c_float
from dataclasses import dataclass
from math import ceil, log2
from typing import NamedTuple

from warp_neural.kernels.errors import InputError, is_finite, require
from warp_neural.kernels.nn.encodings.base import (
    UNROLL,
    Encoding,
    add_entry,
    numbers,
    read_entry,
    require_inputs,
    require_range,
    require_sizes,
)
from warp_neural.kernels.nn.spec import round_up

SHARED_SUMS = 1 << 12, 46 << 10  # entries of a table at most, and bytes of all such tables: what shared memory holds
RESULTS = 8  # of a part, if possible: 16 bytes of float16
PRIMES = (1, 2654435761, 805459861, 3674653429)


class Level(NamedTuple):
    scale: float  # of the input, to vertices
    size: int  # table entries
    start: int  # in floats
    hashed: bool
    factors: list[int]  # of the vertex coordinates: their products are added, or if hashed, combined by exclusive or


def single(value: float) -> float:
    """Rounded to float32."""
    return c_float(value).value


@dataclass(frozen=True)
class HashGrid(Encoding):
    """`levels` * `features` values at a point of [0, 1]^d, d = 1 to 4 (Mueller et al. 2022), d-linear in each cell.

    Level l has base_resolution * growth^l vertices a side and a table of at most 2^log2_size entries of `features`
    floats. A level whose vertices all fit has an entry for each; in a finer one they share entries by a hash. Grids,
    tables and their order are tiny-cuda-nn's (defaults too), and so is the half cell by which all grids are shifted;
    near 1 it lets a dense level reach past its last vertex, where it reads another row's. Results go by level.

    Sizes follow tiny-cuda-nn's float32, so a growth that is no float32 number may add a row of vertices: growth 2^(1/3)
    from 4 vertices has 33 of them, 1,096 entries in 2D, at level 9, and not 32. They could differ by as much where the
    C library rounds `exp2f` or `log2f` otherwise than to nearest. Dimensions are 1 to 4; theirs go to 10.
    """

    levels: int = 16
    features: int = 2
    log2_size: int = 19
    base_resolution: int = 16
    growth: float = 2.0
    initial: tuple[float, float] = (-1e-4, 1e-4)

    def __post_init__(self):
        require_sizes(self, "levels", high=256)
        require_sizes(self, "features", "base_resolution")
        require_sizes(self, "log2_size", high=28)
        require(is_finite(self.growth) and self.growth >= 1, "HashGrid: growth", self.growth, "a number >= 1")
        if log2(self.base_resolution) + log2(self.growth) * (self.levels - 1) > 30:
            raise InputError(f"{self}: more than 2^30 vertices a side; give fewer levels or a smaller growth")
        require_range(self)

    def n_out(self, n_in: int) -> int:
        require_inputs(self, n_in, 1, 4)
        return self.levels * self.features

    @property
    def n_parts(self) -> int:
        n_out = self.levels * self.features
        return n_out // RESULTS if RESULTS % self.features == 0 and n_out % RESULTS == 0 else 1

    @property
    def lanes(self) -> int:
        return 2  # one for each end of the cell along x: they often read one sector

    def shared_sums(self, n_in: int) -> int:
        return sum(table.size * self.features for table in self.tables(n_in)[: self.shared_levels(n_in)])

    def shared_levels(self, n_in: int) -> int:
        entries, bytes = SHARED_SUMS
        tables = self.tables(n_in)
        ends = [table.start + table.size * self.features for table in tables if table.size <= entries]
        return sum(4 * end <= bytes for end in ends)

    def n_parameters(self, n_in: int) -> int:
        last = self.tables(n_in)[-1]
        return last.start + last.size * self.features

    def scale(self, level: int) -> float:
        """Vertices a side, less the one at the end; rounded to float32 where tiny-cuda-nn does (`grid_scale`)."""
        exponent = single(level * single(log2(single(self.growth))))
        return single(single(single(2**exponent) * self.base_resolution) - 1)

    def tables(self, n_in: int) -> list[Level]:
        tables, start = [], 0
        for level in range(self.levels):
            scale = self.scale(level)
            resolution = ceil(scale) + 1
            vertices = resolution**n_in
            size = min(round_up(vertices, 8), 2**self.log2_size)
            hashed = vertices > size
            factors = list(PRIMES[:n_in]) if hashed else [resolution**axis for axis in range(n_in)]
            tables.append(Level(scale, size, start, hashed, factors))
            start += size * self.features
        return tables

    def encode_text(self, n_in: int, aligned: int) -> str:
        values = f"out[(l - first) * {self.features} + c]"
        return self.for_each_level(
            n_in,
            "first",
            "end",
            f"for (int c = 0; c < {self.features}; ++c) {values} = 0.0f;",
            f"""{read_entry(self.features, aligned, "p + at")}
for (int c = 0; c < {self.features}; ++c) {values} += weight * v[c];""",
        )

    def adjoint_text(self, n_in: int, aligned: int) -> str:
        shared = self.shared_levels(n_in)
        return self.for_each_level(
            n_in,
            f"wp::max(first, shared_sums ? 0 : {shared})",
            f"wp::min(end, direct_sums ? {self.levels} : {shared})",
            f"const real* const d = d_out + (l - first) * {self.features};",
            f"""{read_entry(self.features, aligned, "p + at")}
real dot = 0.0f;
for (int c = 0; c < {self.features}; ++c) dot += d[c] * v[c];
for (int a = 0; a < {n_in}; ++a) {{
    real slope = corner >> a & 1 ? scale[l] : -scale[l];
    for (int b = 0; b < {n_in}; ++b) if (b != a) slope *= corner >> b & 1 ? offset[b] : 1.0f - offset[b];
    d_in[a] += slope * dot;
}}
if (grad) {{ {add_entry(self.features, aligned, "grad + at", "weight", "d")} }}""",
        )

    def for_each_level(self, n_in: int, low: str, high: str, begin: str, use: str) -> str:
        """`begin` for each level l of the part, from low to high, then `use` for each corner of the cell there.

        Its weight is `weight`, its entry starts at `at`.
        """
        tables = self.tables(n_in)
        factors = [str(f) + "u" for table in tables for f in table.factors]
        return f"""const real scale[{self.levels}] = {{{numbers(table.scale for table in tables)}}};
const wp::uint32 factor[{len(factors)}] = {{{", ".join(factors)}}};
const wp::uint32 size[{self.levels}] = {{{", ".join(f"{table.size}u" for table in tables)}}};
const wp::int64 start_of[{self.levels}] = {{{", ".join(str(table.start) for table in tables)}}};
const bool hashed[{self.levels}] = {{{", ".join(str(table.hashed).lower() for table in tables)}}};
constexpr int first = {self.levels} * part / parts, end = {self.levels} * (part + 1) / parts;{UNROLL}
for (int l = {low}; l < {high}; ++l) {{
real offset[{n_in}];  // in the cell, 0 to 1
wp::uint32 vertex[{n_in}];
for (int a = 0; a < {n_in}; ++a) {{
    const real position = in[a] * scale[l] + 0.5f, whole = wp::floor(position);
    vertex[a] = static_cast<wp::uint32>(static_cast<wp::int32>(whole));
    offset[a] = position - whole;
}}
{begin}{UNROLL}
for (int k = 0; k < {2**n_in} / lanes; ++k) {{
const int corner = k * lanes | lane;
real weight = 1.0f;
wp::uint32 index = 0u;
for (int a = 0; a < {n_in}; ++a) {{
    const wp::uint32 bit = corner >> a & 1, term = (vertex[a] + bit) * factor[l * {n_in} + a];
    weight *= bit ? offset[a] : 1.0f - offset[a];
    index = hashed[l] ? index ^ term : index + term;
}}
index = hashed[l] ? index & (size[l] - 1u) : index < size[l] ? index : index % size[l];
const wp::int64 at = start_of[l] + static_cast<wp::int64>(index) * {self.features};
{use}
}}
}}
"""
