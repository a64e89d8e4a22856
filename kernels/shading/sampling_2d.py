"""Points of the unit square [0, 1)^2: one a grid cell, and as dense as an image is bright.

All take two uniform numbers u and v in [0, 1), as `wn.random.uniform` draws them.
"""

import warp as wp

MARGIN = wp.constant(2.0**-22)  # more than the roundings of a quotient and of its product with the divisor again


@wp.func
def inside(cell: int, u: float, count: int) -> float:
    """The coordinate in [0, 1) of the part u of `cell`, of `count` <= 2^20: int(coordinate * count) is the cell."""
    low, high = float(cell), float(cell + 1)
    return wp.clamp(low + u, low + low * MARGIN, high - high * MARGIN) / float(count)


@wp.func
def jittered_2d(index: int, columns: int, rows: int, u: float, v: float) -> wp.vec2:
    """A uniform point of cell `index` of a grid, row by row; after the last cell the grid starts again.

    A batch of all cells is a stratified sample: its means vary less than those of independent points.
    """
    cell = index % (columns * rows)
    return wp.vec2(inside(cell % columns, u, columns), inside(cell / columns, v, rows))


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
    x = inside(column, (u - shares[column]) / column_share, width)
    y = inside(row, (v - data.rows[row]) / row_share, height)
    return wp.vec2(x, y), row_share * column_share * (float(width) * float(height))
