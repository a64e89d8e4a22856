"""Points of the unit square [0, 1)^2: one a grid cell, and as dense as an image is bright.

All take two uniform numbers u and v in [0, 1), each a `wp.randf(rng)` of the caller, and not the generator's state:
Warp passes that by value, so a function's draws would not advance the caller's, who would see the same numbers again.
`wp.vec2(wp.randf(rng), wp.randf(rng))` is the uniform point.
"""

import warp as wp

BELOW_ONE = wp.constant(1.0 - 2.0**-24)


@wp.func
def jittered_2d(index: int, columns: int, rows: int, u: float, v: float) -> wp.vec2:
    """A uniform point of cell `index` of a grid, row by row; after the last cell the grid starts again.

    A batch of all cells is a stratified sample: its means vary less than those of independent points.
    """
    cell = index % (columns * rows)
    x = (float(cell % columns) + u) / float(columns)
    y = (float(cell / columns) + v) / float(rows)
    return wp.vec2(wp.min(x, BELOW_ONE), wp.min(y, BELOW_ONE))


@wp.struct
class DensityData:
    """A density over the unit square, constant in each pixel: `warp_neural.Density` makes it.

    rows: [height + 1], the share of all rows before each. columns: [height, width + 1], in each row, of the columns.
    """

    rows: wp.array[float]
    columns: wp.array2d[float]


@wp.func
def last_not_above(shares: wp.array[float], u: float) -> int:
    """i with shares[i] <= u < shares[i + 1], of shares that rise from 0 to 1."""
    low = int(0)
    high = shares.shape[0] - 1
    while high - low > 1:
        middle = (low + high) / 2
        if shares[middle] <= u:
            low = middle
        else:
            high = middle
    return low


@wp.func
def sample_density(data: DensityData, u: float, v: float) -> tuple[wp.vec2, float]:
    """A point (x, y) of [0, 1)^2, x along the columns of the image, and its density relative to a uniform draw's.

    An estimate of a uniform mean weighs the point by 1 / density. Pixels of density 0 are never drawn. The map from
    (u, v) keeps order in each direction, so strata stay strata.
    """
    row = last_not_above(data.rows, v)
    shares = data.columns[row]
    column = last_not_above(shares, u)
    height, width = data.columns.shape[0], data.columns.shape[1] - 1
    row_share, column_share = data.rows[row + 1] - data.rows[row], shares[column + 1] - shares[column]
    x = (float(column) + (u - shares[column]) / column_share) / float(width)
    y = (float(row) + (v - data.rows[row]) / row_share) / float(height)
    return wp.vec2(wp.min(x, BELOW_ONE), wp.min(y, BELOW_ONE)), row_share * column_share * float(width * height)
