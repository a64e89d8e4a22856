"""Which types of vector, bias and result one product takes together, as in VkCooperativeVectorPropertiesNV.

A vector's floats are rounded to the format of the matrix, the 8-bit formats saturating. `wp.int8` is taken as it is,
and so are the four 8-bit values of each `wp.uint32`, the first in its low byte (Vulkan's packed interpretations: a
bitcast where the others convert). int8 has its exact sums as a result, `wp.int32` with int32 biases, modulo 2^32; with
vectors of floats also floats.
"""

import warp as wp

from warp_neural.kernels.errors import require
from warp_neural.kernels.nn.spec import C_TYPES, INT8, Format, accumulations, check_accumulation

PACKED = wp.uint32


def c_type(dtype: type) -> str:
    """Its name in native text."""
    return f"wp::{dtype.__name__}"


def vector_types(format: Format) -> tuple[type, ...]:
    """Of a vector's elements."""
    whole = (wp.int8,) if format is INT8 else ()
    return (*C_TYPES, *whole, PACKED) if format.bits == 8 else tuple(C_TYPES)


def result_types(format: Format, dtype: type) -> tuple[type, ...]:
    """Of the results with vectors of `dtype`, the default first."""
    if dtype in C_TYPES:
        return (dtype, wp.int32) if format is INT8 else (dtype,)
    return (wp.int32,) if format is INT8 else tuple(C_TYPES)


def bias_types(accumulation: str, result: type) -> tuple[str, ...]:
    """The default first."""
    return ("int32",) if result is wp.int32 else tuple(dict.fromkeys(("float32", accumulation)))


def product_types(format: Format) -> list[tuple[str, type, type, str]]:
    """All (accumulation, vector, result, bias) that its products take together."""
    return [
        (accumulation, dtype, result, bias)
        for accumulation in accumulations(format)
        for dtype in vector_types(format)
        for result in result_types(format, dtype)
        for bias in bias_types(accumulation, result)
    ]


def check_product(
    format: Format, accumulation: str, dtype: type, result: type | None, bias: str | None
) -> tuple[type, str]:
    """Result and bias, the defaults where they are None; raises `InputError` for types that no product takes."""
    check_accumulation(format, accumulation)
    more = {wp.int8: "wp.int8", PACKED: "wp.uint32, four 8-bit values in each"}
    more = "".join(f", {text}" for kind, text in more.items() if kind in vector_types(format))
    expected = f"wp.float32 or wp.float16{more}, the vectors' element type"
    require(dtype in vector_types(format), "dtype", dtype, expected)
    results = result_types(format, dtype)
    result = results[0] if result is None else result
    require(result in results, "result", result, " or ".join(f"wp.{kind.__name__}" for kind in results))
    biases = bias_types(accumulation, result)
    bias = biases[0] if bias is None else bias
    require(bias in biases, "bias", bias, f"{'one of ' if len(biases) > 1 else ''}{', '.join(biases)}")
    return result, bias
