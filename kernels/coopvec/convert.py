"""Where each element of one matrix lies in each layout, and the kernel that converts between layouts and formats.

A matrix is [rows n, columns k]; an element index counts elements of the format from the matrix's start. `stride` is in
elements, between rows (column major: between columns), 0 for tight. The layouts are the same on every device:

row_major, column_major: as everywhere; only these have a stride, and files hold only row major.
inferencing_optimal: the B operands of `mma.sync` as `layout.py` packs them, tiles of 8 rows by two K blocks; float32:
row major, rows padded to 4 elements.
training_optimal: the accumulators of `mma.sync` m16n8, tiles of 16 rows by 8 columns, 4 elements a lane.
"""

from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.formats import make_decode, make_encode
from warp_neural.kernels.coopvec.layout import make_fragment_coordinates
from warp_neural.kernels.nn.spec import FORMATS, Format, round_up

LAYOUTS = ("row_major", "column_major", "inferencing_optimal", "training_optimal")
STRIDED = LAYOUTS[:2]
BY_STEP = {format.k_step: format for format in FORMATS.values()}  # formats of one K step share their element order
ORDERS = [(layout, 0) for layout in LAYOUTS] + [("inferencing_optimal", step) for step in BY_STEP if step]


def order(layout: str, format: Format) -> int:
    """Which of `ORDERS`, the distinct orders of elements."""
    return ORDERS.index((layout, format.k_step if layout == "inferencing_optimal" else 0))


def matrix_elements(layout: str, format: Format, rows: int, columns: int, stride: int = 0) -> int:
    """From the first element of the matrix to its last, padding of the optimal layouts included."""
    if layout == "training_optimal":
        return round_up(rows, 16) * round_up(columns, 8)
    if layout == "inferencing_optimal":
        step = format.k_step
        return round_up(rows, 8) * round_up(columns, 2 * step) if step else rows * round_up(columns, 4)
    lines, length = (rows, columns) if layout == "row_major" else (columns, rows)
    return (lines - 1) * (stride or length) + length


def element_index(layout: str, format: Format, rows: str, columns: str, stride: str) -> str:
    """C++ expression of the element index of row `n`, column `k`, from the expressions of the matrix's sizes."""
    if layout == "row_major":
        return f"n * ({stride} ? {stride} : {columns}) + k"
    if layout == "column_major":
        return f"k * ({stride} ? {stride} : {rows}) + n"
    if layout == "training_optimal":
        # PTX ISA, accumulators of m16n8: lane 4 (n % 8) + k % 8 / 2 holds rows n, n + 8 and columns k, k + 1
        lane = "n % 8 * 4 + k % 8 / 2"
        return f"((n / 16 * (({columns} + 7) / 8) + k / 8) * 32 + {lane}) * 4 + n % 16 / 8 * 2 + k % 2"
    step, half, per_word = format.k_step, format.k_step // 2, format.per_word
    if step == 0:
        return f"n * (({columns} + 3) / 4 * 4) + k"
    register, element = ("k % 2", "0") if per_word == 1 else (f"k % {step} / {half}", f"(k % 2 + k % {half} / 8 * 2)")
    tile = f"(n / 8 * (({columns} + {2 * step - 1}) / {2 * step}) + k / {2 * step})"  # the inverse of layout.py's order
    word = f"({tile} * 32 + n % 8 * 4 + k % 8 / 2) * 4 + k / {step} % 2 * 2 + {register}"
    return f"({word}) * {per_word} + {element}"


@cache
def make_element_index(layout: str, format: Format) -> wp.Function:
    """`(n, k, rows, columns, stride) -> element index` of one matrix."""

    @wp.func_native(f"return {element_index(layout, format, 'rows', 'columns', 'stride')};")
    def index(n: int, k: int, rows: int, columns: int, stride: int) -> int: ...

    return index


@wp.func
def row_major_coordinates(i: int, rows: int, columns: int, stride: int):
    length = wp.where(stride > 0, stride, columns)
    return i / length, i % length


@wp.func
def column_major_coordinates(i: int, rows: int, columns: int, stride: int):
    length = wp.where(stride > 0, stride, rows)
    return i % length, i / length


@wp.func
def padded_coordinates(i: int, rows: int, columns: int, stride: int):
    length = (columns + 3) / 4 * 4
    return i / length, i % length


@wp.func
def training_coordinates(i: int, rows: int, columns: int, stride: int):
    tiles = (columns + 7) / 8
    tile = i / 128
    return tile / tiles * 16 + i % 4 / 2 * 8 + i / 4 % 32 / 4, tile % tiles * 8 + i / 4 % 4 * 2 + i % 2


@cache
def make_fragment_inverse(k_step: int) -> wp.Function:
    coordinates = make_fragment_coordinates(BY_STEP[k_step])
    step, per_word = wp.constant(k_step), wp.constant(BY_STEP[k_step].per_word)

    @wp.func
    def fragment_inverse(i: int, rows: int, columns: int, stride: int):
        n, k = coordinates(i / per_word, i % per_word, (columns + step - 1) / step * step)
        return n, k

    return fragment_inverse


INDEX = [make_element_index(layout, BY_STEP[step]) for layout, step in ORDERS]
COORDINATES = [row_major_coordinates, column_major_coordinates, padded_coordinates, training_coordinates]
COORDINATES += [make_fragment_inverse(step) for _, step in ORDERS[4:]]
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
        n = int(0)
        k = int(0)
        for o in range(wp.static(len(ORDERS))):
            if target.order == o:
                n, k = wp.static(COORDINATES[o])(word * target.per_word + element, rows, columns, target.stride)
        bits = wp.uint32(0)
        inside = n < rows and k < columns
        if inside:
            value = read(source, n, k, rows, columns)
            for f in range(wp.static(len(FORMATS))):
                if target.format == f:
                    bits = wp.static(ENCODE[f])(value)
        if inside or target.padded:
            shift = wp.uint32(element * size)
            mask = (~wp.uint32(0) >> wp.uint32(32 - size)) << shift
            result = (result & ~mask) | (bits << shift)
    target.words[word] = result
