"""Where each element of one matrix lies in each layout, and the kernel that converts between layouts and formats.

A matrix is [rows n, columns k]; an element index counts elements of the format from the matrix's start. `stride` is in
elements, between rows (column major: between columns), 0 for tight. The layouts are the same on every device:

row_major, column_major: as everywhere; only these have a stride, and files hold only row major.
inferencing_optimal: the B operands of `mma.sync`, tiles of 8 rows by two K blocks; float32: row major, rows padded to 4
elements.
training_optimal: the accumulators of `mma.sync` m16n8, tiles of 16 rows by 8 columns, 4 elements a lane.
"""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.formats import make_decode, make_encode
from warp_neural.kernels.coopvec.fragment_layout import (
    Layout,
    Number,
    Text,
    accumulators,
    column_major,
    operands,
    row_major,
)
from warp_neural.kernels.nn.spec import FORMATS, Format

LAYOUTS = ("row_major", "column_major", "inferencing_optimal", "training_optimal")
STRIDED = LAYOUTS[:2]
BY_STEP = {format.k_step: format for format in FORMATS.values()}  # formats of one K step share their element order
ORDERS = [(layout, 0) for layout in LAYOUTS] + [("inferencing_optimal", step) for step in BY_STEP if step]


def order(layout: str, format: Format) -> int:
    """Which of `ORDERS`, the distinct orders of elements."""
    return ORDERS.index((layout, format.k_step if layout == "inferencing_optimal" else 0))


def matrix_layout(layout: str, format: Format, rows: Number, columns: Number) -> Layout:
    if layout == "row_major":
        return row_major(rows, columns)
    if layout == "column_major":
        return column_major(rows, columns)
    if layout == "training_optimal":
        return accumulators(rows, columns)
    return operands(format, rows, columns) if format.k_step else row_major(rows, (columns + 3) // 4 * 4)


def matrix_elements(layout: str, format: Format, rows: int, columns: int, stride: int = 0) -> int:
    """From the first element of the matrix to its last, padding of the optimal layouts included."""
    if layout not in STRIDED:
        return matrix_layout(layout, format, rows, columns).elements
    lines, length = (rows, columns) if layout == "row_major" else (columns, rows)
    return (lines - 1) * (stride or length) + length


def layout_text(layout: str, format: Format, rows: str, columns: str, stride: str) -> Layout:
    """Of C++ expressions of a matrix's sizes."""
    if layout == "row_major":
        columns = f"{stride} ? {stride} : {columns}"
    if layout == "column_major":
        rows = f"{stride} ? {stride} : {rows}"
    return matrix_layout(layout, format, Text(f"({rows})"), Text(f"({columns})"))


@cache
def make_element_index(layout: str, format: Format) -> wp.Function:
    """`(n, k, rows, columns, stride) -> element index` of one matrix."""
    index = layout_text(layout, format, "rows", "columns", "stride").index(Text("n"), Text("k"))

    @wp.func_native(f"return {index};")
    def element_index(n: int, k: int, rows: int, columns: int, stride: int) -> int: ...

    return element_index


@cache
def make_element_place(layout: str, format: Format) -> wp.Function:
    """`(element index, rows, columns, stride) -> (n, k)`, the inverse."""
    n, k = layout_text(layout, format, "rows", "columns", "stride").place(Text("i"))

    @wp.func_native(f"return wp::vec_t<2, int>({n}, {k});")
    def element_place(i: int, rows: int, columns: int, stride: int) -> wp.vec2i: ...

    return element_place


INDEX = [make_element_index(layout, BY_STEP[step]) for layout, step in ORDERS]
PLACE = [make_element_place(layout, BY_STEP[step]) for layout, step in ORDERS]
ENCODE, DECODE = [make_encode(f) for f in FORMATS.values()], [make_decode(f) for f in FORMATS.values()]


@wp.struct
class Matrix:
    """A stored matrix. words: from its first byte on. order, format: indices into `ORDERS` and `FORMATS`. padded: what
    lies between its elements is written as zero, and otherwise left as it is."""

    words: wp.array[wp.uint32]
    order: int
    format: int
    per_word: int
    stride: int
    padded: bool


@wp.func
def read(matrix: Matrix, n: int, k: int, rows: int, columns: int) -> float:
    i = int(0)
    for o in range(wp.static(len(ORDERS))):
        if matrix.order == o:
            i = wp.static(INDEX[o])(n, k, rows, columns, matrix.stride)
    size = 32 / matrix.per_word
    bits = matrix.words[i / matrix.per_word] >> wp.uint32(i % matrix.per_word * size)
    bits = bits & (~wp.uint32(0) >> wp.uint32(32 - size))
    value = float(0.0)
    for f in range(wp.static(len(FORMATS))):
        if matrix.format == f:
            value = wp.static(DECODE[f])(bits)
    return value


@wp.kernel(module="unique", enable_backward=False)
def convert_kernel(rows: int, columns: int, source: Matrix, target: Matrix):
    """One thread a word of the target. One kernel for all layouts and formats: it waits for memory anyway."""
    word = wp.tid()
    size = 32 / target.per_word
    result = target.words[word]
    for element in range(target.per_word):
        at = wp.vec2i()
        for o in range(wp.static(len(ORDERS))):
            if target.order == o:
                at = wp.static(PLACE[o])(word * target.per_word + element, rows, columns, target.stride)
        bits = wp.uint32(0)
        inside = at[0] < rows and at[1] < columns
        if inside:
            value = read(source, at[0], at[1], rows, columns)
            for f in range(wp.static(len(FORMATS))):
                if target.format == f:
                    bits = wp.static(ENCODE[f])(value)
        if inside or target.padded:
            shift = wp.uint32(element * size)
            mask = (~wp.uint32(0) >> wp.uint32(32 - size)) << shift
            result = (result & ~mask) | (bits << shift)
    target.words[word] = result
