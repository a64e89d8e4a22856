"""Matrices for the cooperative-vector operations: sizes, conversion between layouts and precisions, what is supported.

A matrix is [rows, columns], 1 to 256 each, in one of four layouts: "row_major" and "column_major", with an optional
stride; "inferencing_optimal", the order in which tensor cores read weights; "training_optimal", the order in which they
accumulate gradients. The optimal layouts are the same on every device, but may change with the version: files hold row
major only. Precisions: float32, tf32, float16, bfloat16, e4m3, e5m2, int8. Sizes, strides and offsets are in bytes.
The `make_` factories return the device functions: the four operations, loads and stores.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_neural.coopvec.combinations import Combination, check_combination, combination_table, supported_combinations
from warp_neural.errors import InputError, find_device
from warp_neural.kernels.coopvec.convert import LAYOUTS, STRIDED, Matrix, convert_kernel, matrix_elements, order
from warp_neural.kernels.coopvec.memory import make_load, make_store
from warp_neural.kernels.coopvec.operations import (
    Buffer,
    MatrixSpec,
    make_matmul,
    make_matmul_add,
    make_outer_product_accumulate,
    make_reduce_sum_accumulate,
)
from warp_neural.kernels.errors import require, require_whole
from warp_neural.kernels.nn.spec import FORMATS, MAX_SIZE, Format, format_of, round_up

__all__ = [
    "Buffer",
    "Combination",
    "MatrixSpec",
    "check_combination",
    "combination_table",
    "convert_matrix",
    "make_load",
    "make_matmul",
    "make_matmul_add",
    "make_outer_product_accumulate",
    "make_reduce_sum_accumulate",
    "make_store",
    "matrix_size",
    "pack_matrix",
    "supported_combinations",
    "unpack_matrix",
]

Array = wp.array | np.ndarray
ELEMENT_TYPES = {"tf32": "float32", "e4m3": "float8_e4m3fn", "e5m2": "float8_e5m2"}  # of arrays, where not the same


@dataclass(frozen=True)
class _Stored:
    """Where a matrix lies in a buffer; `name` (source or target) begins the error messages."""

    name: str
    rows: int
    columns: int
    precision: str
    layout: str
    stride: int = 0
    offset: int = 0

    def __post_init__(self):
        require_whole("rows", self.rows, 1, MAX_SIZE)
        require_whole("columns", self.columns, 1, MAX_SIZE)
        require_whole(f"{self.name} stride", self.stride, 0)
        require_whole(f"{self.name} offset", self.offset, 0)
        format_of(self.precision, f"{self.name} precision")
        require(self.layout in LAYOUTS, f"{self.name} layout", self.layout, f"one of {', '.join(LAYOUTS)}")
        strided = self.layout in STRIDED
        if self.stride and not strided:
            raise InputError(f"{self.name} stride {self.stride}: {self.layout} has none")
        line = (self.columns if self.layout == "row_major" else self.rows) * self.element_bytes
        if self.stride and (self.stride < line or self.stride % self.element_bytes):
            raise InputError(
                f"{self.name} stride {self.stride}: expected 0 (tight) or a multiple of {self.element_bytes} "
                f"from {line} on, in bytes"
            )
        if self.offset % (4 if strided else 16):
            raise InputError(f"{self.name} offset {self.offset}: expected a multiple of {4 if strided else 16} bytes")

    @property
    def format(self) -> Format:
        return format_of(self.precision)

    @property
    def element_bytes(self) -> int:
        return self.format.bits // 8

    @property
    def bytes(self) -> int:
        stride = self.stride // self.element_bytes
        return self.element_bytes * matrix_elements(self.layout, self.format, self.rows, self.columns, stride)

    def check(self, buffer: Array) -> None:
        """Its element type, and that the device can see it as words."""
        expected = "a Warp or NumPy array"
        require(isinstance(buffer, wp.array | np.ndarray), f"{self.name} buffer", type(buffer).__name__, expected)
        host = isinstance(buffer, np.ndarray)
        name = buffer.dtype.name if host else buffer.dtype.__name__
        allowed = ("uint32", "uint8", ELEMENT_TYPES.get(self.precision, self.precision))
        if name not in allowed:
            raise InputError(f"{self.name} buffer of {name}: {self.precision} is held by {', '.join(allowed)}")
        if not host and (not buffer.is_contiguous or (buffer.ptr or 0) % 4):
            raise InputError(f"{self.name} buffer: expected a contiguous array that starts at a multiple of 4 bytes")

    def matrix(self, words: wp.array) -> Matrix:
        """The argument of the kernel."""
        first, n = self.offset // 4, -(-self.bytes // 4)
        if first + n > len(words):
            raise InputError(
                f"{self.name} buffer of {4 * len(words)} bytes: a {self.rows} x {self.columns} matrix of "
                f"{self.precision}, {self.layout}, ends at byte {4 * (first + n)}"
            )
        matrix = Matrix()
        matrix.words, matrix.order = words[first : first + n], order(self.layout, self.format)
        matrix.format, matrix.per_word = list(FORMATS).index(self.precision), self.format.per_word
        matrix.stride, matrix.padded = self.stride // self.element_bytes, self.layout not in STRIDED
        return matrix


def matrix_size(rows: int, columns: int, precision: str, layout: str, stride: int = 0) -> int:
    """Bytes that a matrix needs, a multiple of 16. Let those that share a buffer start at multiples of 64."""
    return round_up(_Stored("matrix", rows, columns, precision, layout, stride).bytes, 16)


def convert_matrix(
    source: Array,
    rows: int,
    columns: int,
    source_precision: str,
    source_layout: str,
    target_precision: str,
    target_layout: str,
    *,
    source_stride: int = 0,
    target_stride: int = 0,
    source_offset: int = 0,
    target: Array | None = None,
    target_offset: int = 0,
    device: wp.DeviceLike = None,
) -> Array:
    """Convert a matrix; returns the buffer that holds the result: `target`, or else new uint32 words.

    Values round to nearest even (tf32: ties away from zero), the 8-bit formats saturating; int8 takes whole numbers of
    -128 to 127, without a scale. Padding of the optimal layouts becomes zero; bytes of `target` between the rows of a
    stride stay as they are.

    source, target: arrays of uint32 words, uint8 bytes, or elements of the precision (float32 for tf32). The work is
    done on `device`, or else where `target` or `source` is; from NumPy without any of these, a NumPy array returns.
    With both on one device it is one launch, which a CUDA graph can hold. They must not overlap. Offsets are multiples
    of 4 bytes, in the optimal layouts of 16.
    """
    source_at = _Stored("source", rows, columns, source_precision, source_layout, source_stride, source_offset)
    target_at = _Stored("target", rows, columns, target_precision, target_layout, target_stride, target_offset)
    given = [a.device for a in (target, source) if isinstance(a, wp.array)]
    to_host = device is None and not given
    device = find_device(device or (given[0] if given else "cpu"))
    if target is None:
        target = wp.zeros((target_offset + round_up(target_at.bytes, 16)) // 4, dtype=wp.uint32, device=device)
    elif isinstance(target, wp.array) and target.device != device:
        raise InputError(f"target buffer is on {target.device}, not on {device}")
    source_at.check(source)
    target_at.check(target)
    source = source if isinstance(source, np.ndarray) else source.to(device)  # alive until launched
    target_words = _as_words(target, device)
    arguments = [rows, columns, source_at.matrix(_as_words(source, device)), target_at.matrix(target_words)]
    wp.launch(convert_kernel, len(arguments[3].words), arguments, device=device, record_tape=False)
    if isinstance(target, np.ndarray):
        np.copyto(target, np.frombuffer(target_words.numpy(), target.dtype, target.size).reshape(target.shape))
    elif to_host:
        target = target.numpy()
    return target


def _as_words(buffer: Array, device: wp.Device) -> wp.array:
    """A NumPy array is copied; of a Warp array it is a view."""
    if isinstance(buffer, np.ndarray):
        words = np.zeros(-(-buffer.nbytes // 4), np.uint32)
        words.view(np.uint8)[: buffer.nbytes] = np.frombuffer(buffer.tobytes(), np.uint8)
        return wp.array(words, dtype=wp.uint32, device=device)
    n = buffer.size * wp.types.type_size_in_bytes(buffer.dtype) // 4
    return wp.array(ptr=buffer.ptr, dtype=wp.uint32, shape=n, device=device)


def pack_matrix(values: np.ndarray, precision: str, layout: str, device: wp.DeviceLike = None) -> Array:
    """`values` [rows, columns] as new words, in NumPy or on `device`."""
    try:
        values = np.asarray(values, np.float32)
    except (TypeError, ValueError):
        raise InputError("values: no array of numbers; expected [rows, columns]") from None
    if values.ndim != 2:
        raise InputError(f"values: shape {values.shape}; expected [rows, columns]")
    return convert_matrix(values, *values.shape, "float32", "row_major", precision, layout, device=device)


def unpack_matrix(words: Array, rows: int, columns: int, precision: str, layout: str, offset: int = 0) -> np.ndarray:
    """The float32 values [rows, columns] of a stored matrix."""
    values = np.empty((rows, columns), np.float32)
    return convert_matrix(
        words, rows, columns, precision, layout, "float32", "row_major", source_offset=offset, target=values
    )
