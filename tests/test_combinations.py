"""Which types a product takes together, and the error that shows them."""

import itertools
from contextlib import nullcontext

import pytest
import warp as wp

from warp_neural import MLP, InputError
from warp_neural.coopvec import MatrixSpec, check_combination, combination_table, supported_combinations
from warp_neural.kernels.nn.spec import FORMATS, NetworkSpec

# Vulkan specification, VkCooperativeVectorPropertiesNV: the combinations that every device must take
REQUIRED = """
FLOAT16 FLOAT16      FLOAT16 FLOAT16 FLOAT16
UINT32  SINT8_PACKED SINT8   SINT32  SINT32
SINT8   SINT8        SINT8   SINT32  SINT32
FLOAT32 SINT8        SINT8   SINT32  SINT32
FLOAT16 FLOAT_E4M3   FLOAT_E4M3 FLOAT16 FLOAT16
FLOAT16 FLOAT_E5M2   FLOAT_E5M2 FLOAT16 FLOAT16
"""


@pytest.mark.parametrize("row", REQUIRED.strip().splitlines())
def test_every_row_that_vulkan_requires(row, device):
    types = [name.lower().replace("sint", "int").removeprefix("float_") for name in row.split()]
    assert types in [list(vars(c).values())[:5] for c in supported_combinations(device)]


def test_packed_types_of_every_8_bit_format(device):
    packed = {c.input_interpretation for c in supported_combinations(device) if c.input_type == "uint32"}
    assert packed == {"int8_packed", "e4m3_packed", "e5m2_packed"}


def test_combinations(device):
    """All that a network takes, whole numbers and packed ones besides; tensor cores multiply what there are."""
    combinations = supported_combinations(device)
    assert len(combinations) == len(set(combinations)) == 42
    for c in combinations:
        oldest = FORMATS[c.matrix_interpretation].min_arch
        assert c.native == (device.is_cuda and oldest > 0 and device.arch >= oldest)
    taken = {(c.input_interpretation, c.accumulation.replace("int32", "float32"), c.input_type) for c in combinations}
    for kind in itertools.product(FORMATS, ("float32", "float16"), (wp.float32, wp.float16, wp.float64)):
        with nullcontext() if (*kind[:2], kind[2].__name__) in taken else pytest.raises(ValueError):
            NetworkSpec((1, 1), format=FORMATS[kind[0]], accumulation=kind[1], dtype=kind[2])


REFUSED = [
    (("float8",), "precision='float8': expected one of float32, tf32"),
    (("bfloat16", "float16"), "bfloat16 accumulates in float32 only"),
    (("float16", "float64"), "accumulation='float64': expected one of float32, float16"),
    (("float16", "float32", wp.float64), "expected wp.float32 or wp.float16"),
    (("float16", "float32", wp.float32, "float16"), "bias='float16': expected float32"),
    (("float16", "float16", wp.float32, "bfloat16"), "bias='bfloat16': expected one of float32, float16"),
    (("float16", "float32", wp.uint32), "dtype=.*: expected wp.float32 or wp.float16, the vectors'"),
    (("e4m3", "float32", wp.int8), "dtype=.*: expected wp.float32 or wp.float16, wp.uint32, four 8-bit values in each"),
    (("int8", "float32", wp.int32), "dtype=.*: expected wp.float32 or wp.float16, wp.int8, wp.uint32, four 8-bit"),
    (("int8", "float32", wp.int8, "float32"), "bias='float32': expected int32"),
    (("int8", "float32", wp.float32, "int32"), "bias='int32': expected float32"),
]


@pytest.mark.parametrize(("arguments", "reason"), REFUSED)
def test_unsupported_combination_is_one_line_that_points_to_the_table(arguments, reason, device):
    table = combination_table(device)
    assert len({len(line) for line in table.splitlines()}) == 1
    with pytest.raises(InputError, match=reason) as error:
        check_combination(*arguments, device=device)
    assert str(error.value).endswith("; coopvec.combination_table() shows what is supported")
    assert "\n" not in str(error.value)


def test_supported_combinations_pass(device):
    for c in supported_combinations(device):
        accumulation = c.accumulation.replace("int32", "float32")
        dtype, result = getattr(wp, c.input_type), getattr(wp, c.result_type)
        check_combination(c.matrix_interpretation, accumulation, dtype, c.bias_interpretation, device, result=result)


def test_result_types():
    for arguments, expected in [
        (("int8", wp.int8, wp.float32), "wp.int32"),
        (("float16", wp.float32, wp.float16), "wp.float32"),
        (("int8", wp.float16, wp.float32), "wp.float16 or wp.int32"),
        (("e5m2", wp.uint32, wp.int32), "wp.float32 or wp.float16"),
    ]:
        precision, dtype, result = arguments
        with pytest.raises(InputError, match=f"result=.*: expected {expected}"):
            MatrixSpec(3, 5, precision, dtype=dtype, result=result)
    assert MatrixSpec(3, 5, "int8", dtype=wp.int8) == MatrixSpec(
        3, 5, "int8", "inferencing_optimal", False, wp.int8, bias="int32", result=wp.int32
    )
    assert MatrixSpec(3, 5, "e4m3", dtype=wp.uint32).vec_in == wp.types.vector(2, wp.uint32)


def test_networks_refuse_in_one_line():
    with pytest.raises(InputError, match="tf32 accumulates in float32 only; float16, e4m3") as error:
        MLP(3, 2, precision="tf32", accumulation="float16", device="cpu")
    assert "\n" not in str(error.value)
