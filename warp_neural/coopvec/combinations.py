"""Which combinations of vector, matrix, bias and result types the cooperative-vector functions take on a device."""

from dataclasses import astuple, dataclass, fields

import warp as wp

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.coopvec.product_types import PACKED, check_product, product_types
from warp_neural.kernels.nn.spec import FORMATS, INT8, format_of


@dataclass(frozen=True)
class Combination:
    """Types that a product takes together, as in VkCooperativeVectorPropertiesNV.

    Vulkan's names: int8, int32 and uint32 are SINT8, SINT32 and UINT32; int8_packed is SINT8_PACKED, four values in
    each uint32; e4m3 and e5m2 are FLOAT_E4M3 and FLOAT_E5M2, which may be packed here too. transpose: whether the
    matrix may be read transposed. native: whether the device's tensor cores multiply it; where not, per-thread
    arithmetic rounds at the same places. For Hopper (sm_90), `mma.sync` on e4m3 and e5m2 compiles to conversions and
    float16 products: there they save memory, but are not faster than float16.
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
        for accumulation, dtype, result, bias in product_types(format):
            row = (
                dtype.__name__,
                f"{format.name}_packed" if dtype is PACKED else format.name,
                format.name,
                bias,
                result.__name__,
                "int32" if format is INT8 else accumulation,
                True,
                native,
            )
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
    bias: str | None = None,
    device: wp.DeviceLike = None,
    *,
    result: type | None = None,
) -> None:
    """Raise `InputError`, with the reason, unless matrices of `precision` multiply vectors of `dtype`.

    The arguments are those of `MatrixSpec`: accumulation "float32" (int8: stands for int32) or "float16"; bias and
    result None for what goes with the others.
    """
    try:
        check_product(format_of(precision), accumulation, dtype, result, bias)
    except InputError as error:
        raise InputError(f"{error}; coopvec.combination_table() shows what is supported") from None
