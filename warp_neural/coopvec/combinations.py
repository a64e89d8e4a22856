"""Which combinations of vector, matrix, bias and result types the cooperative-vector functions take on a device."""

from dataclasses import astuple, dataclass, fields

import warp as wp

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.nn.spec import E4M3, E5M2, FLOAT16, FORMATS, INT8, check_types, format_of


@dataclass(frozen=True)
class Combination:
    """Types that a product takes together, as in VkCooperativeVectorPropertiesNV.

    transpose: whether the matrix may be read transposed. native: whether the device's tensor cores multiply it; where
    not, per-thread arithmetic rounds at the same places. For Hopper (sm_90), `mma.sync` on e4m3 and e5m2 compiles to
    conversions and float16 products: there they save memory, but are not faster than float16.
    """

    input_type: str
    input_interpretation: str
    matrix_interpretation: str
    bias_interpretation: str
    result_type: str
    accumulation: str
    transpose: bool
    native: bool


def supported_combinations(device: wp.DeviceLike = None) -> list[Combination]:
    device, combinations = find_device(device), []
    for format in FORMATS.values():
        native = device.is_cuda and format.k_step > 0 and device.arch >= format.min_arch
        kinds = [("int32" if format is INT8 else "float32", "float32")]  # accumulation, bias
        if format in (FLOAT16, E4M3, E5M2):
            kinds += [("float16", "float32"), ("float16", "float16")]
        for accumulation, bias in kinds:
            for vector in ("float32", "float16"):
                row = (vector, format.name, format.name, bias, vector, accumulation, True, native)
                combinations.append(Combination(*row))
    return combinations


def combination_table(device: wp.DeviceLike = None) -> str:
    """`supported_combinations` as Markdown with aligned columns."""
    rows = [[field.name for field in fields(Combination)]]
    for combination in supported_combinations(device):
        rows.append([{True: "yes", False: "no"}.get(value, value) for value in astuple(combination)])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    rows.insert(1, ["-" * width for width in widths])
    return "\n".join("| " + " | ".join(map(str.ljust, row, widths)) + " |" for row in rows)


def check_combination(
    precision: str,
    accumulation: str = "float32",
    dtype: type = wp.float32,
    bias: str = "float32",
    device: wp.DeviceLike = None,
) -> None:
    """Raise `InputError`, with the reason and the table, unless matrices of `precision` multiply vectors of `dtype`.

    accumulation: "float32" (int8: stands for int32) or "float16". bias: "float32", or "float16" with such accumulation.
    """
    try:
        check_types(format_of(precision), accumulation, dtype, bias)
    except InputError as error:
        table = combination_table(device)
        raise InputError(f"{error}; on {find_device(device)} these are supported:\n{table}") from None
