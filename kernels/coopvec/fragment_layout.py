"""Orders of elements in memory, each described once; indices, their inverses and C++ text follow.

An order is a permutation of digits. A coordinate is a number of mixed radix, least significant digit first: column
k = e + 2 t + 8 register of a matrix is "e:2 t:4 register"; memory has the same digits in an order of its own. The last
digit of a coordinate has no extent: it follows from the size. Letters are those of PTX's fragments, lane = 4 g + t.

The arithmetic is //, %, * and + of what is not negative: of numbers, NumPy arrays, and `Text`, C++ expressions.
"""

from dataclasses import dataclass
from math import prod

from warp_neural.kernels.nn.spec import Format


@dataclass(frozen=True)
class Text:
    """C++ expression of a whole number that is not negative: a name, a product of such, or in parentheses."""

    text: str

    def __str__(self):
        return self.text

    def __add__(self, other):
        return self if other == 0 else Text(f"({self} + {other})")

    def __mul__(self, other):
        return self if other == 1 else Text(f"{self} * {factor(other)}")

    def __floordiv__(self, other):
        return self if other == 1 else Text(f"{self} / {factor(other)}")

    def __mod__(self, other):
        return Text(f"{self} % {factor(other)}")

    __radd__, __rmul__ = __add__, __mul__


Number = int | Text  # or an array of integers


def factor(number: Number) -> str:
    return f"({number})" if isinstance(number, Text) else f"{number}"


@dataclass(frozen=True)
class Order:
    """A number of mixed radix. extents: of its digits by name, the least significant first."""

    extents: dict[str, Number]

    def split(self, number: Number) -> dict[str, Number]:
        """Its digits."""
        digits, weight, last = {}, 1, next(reversed(self.extents), None)
        for name, extent in self.extents.items():
            digits[name] = number // weight if name == last else number // weight % extent
            weight = weight * extent
        return digits

    def join(self, **digits: Number) -> Number:
        """The number of such digits. Those left out are zero; those that it does not have do not matter."""
        number, weight = 0, 1
        for name, extent in self.extents.items():
            if name in digits:
                number = number + digits[name] * weight
            weight = weight * extent
        return number

    def only(self, *names: str) -> "Order":
        """Of these digits, where it has them: in memory, of elements in a register or of 16-byte units."""
        return Order({name: extent for name, extent in self.extents.items() if name in names})


@dataclass(frozen=True)
class Layout:
    """Where the elements of a matrix (axes: rows, columns) or vector (one axis) lie in memory."""

    axes: tuple[Order, ...]
    memory: Order

    @property
    def elements(self) -> Number:
        """With the padding to whole tiles."""
        return prod(self.memory.extents.values())

    @property
    def transposed(self) -> "Layout":
        """The same, of the matrix whose columns are these rows."""
        return Layout(self.axes[::-1], self.memory)

    def index(self, *place: Number) -> Number:
        """In memory, of row n, column k, or of element n of a vector."""
        digits = {}
        for axis, coordinate in zip(self.axes, place, strict=True):
            digits |= axis.split(coordinate)
        return self.memory.join(**digits)

    def place(self, index: Number) -> tuple[Number, ...]:
        """The inverse of `index`."""
        digits = self.memory.split(index)
        return tuple(axis.join(**digits) for axis in self.axes)


def layout(memory: str, *axes: tuple[str, Number]) -> Layout:
    """memory: names of digits. axes: of each its digits and its size."""
    orders = []
    for names, size in axes:
        *inner, outer = names.split()
        extents = {name: int(extent) for name, extent in (digit.split(":") for digit in inner)}
        inside = prod(extents.values())
        orders.append(Order(extents | {outer: (size + (inside - 1)) // inside}))
    extents = {name: extent for order in orders for name, extent in order.extents.items()}
    return Layout(tuple(orders), Order({name: extents[name] for name in memory.split()}))


def row_major(rows: Number, columns: Number) -> Layout:
    return layout("k n", ("n", rows), ("k", columns))


def column_major(rows: Number, columns: Number) -> Layout:
    return layout("n k", ("n", rows), ("k", columns))


# By bits of an element: the columns' digits, and those of one register. 8 bits and TF32: the columns of a K block are
# not in PTX's order but, as those of vectors that stay in registers from product to product, in that of accumulators.
OPERANDS = {
    8: ("e:2 t:4 upper:2 register:2 half:2 pair", "e upper"),
    16: ("e:2 t:4 register:2 half:2 pair", "e"),
    32: ("register:2 t:4 half:2 pair", ""),
}


def operands(format: Format, rows: Number, columns: Number) -> Layout:
    """B operands of `mma.sync` (PTX ISA: m16n8k16, m16n8k32, m16n8k8), columns of B being rows of the matrix.

    16 bytes of a lane are two registers for each of two K blocks: one 128-bit load for two products.
    """
    digits, element = OPERANDS[format.bits]
    return layout(f"{element} register half t g pair tile", ("g:8 tile", rows), (digits, columns))


def accumulators(rows: Number, columns: Number) -> Layout:
    """Of `mma.sync` m16n8, four registers of a lane after the other."""
    return layout("e upper t g tile block", ("g:8 upper:2 block", rows), ("e:2 t:4 tile", columns))


def warpgroup_accumulators(rows: Number, columns: Number) -> Layout:
    """Of `wgmma` m64nN, registers one after the other, each of 128 threads; 64 rows after the other."""
    return layout("t g warp e upper tile part", ("g:8 upper:2 warp:4 part", rows), ("e:2 t:4 tile", columns))


def biases(n: Number) -> Layout:
    """Float32: 16 bytes of a lane are its columns of two tiles of accumulators."""
    return layout("e tile t rest", ("e:2 t:4 tile:2 rest", n))


def half_biases(n: Number) -> Layout:
    """Float16: of four tiles."""
    return layout("e tile t rest", ("e:2 t:4 tile:4 rest", n))
