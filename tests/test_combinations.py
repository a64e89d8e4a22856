"""Which types a product takes together, and the error that shows them."""

import itertools
from contextlib import nullcontext

import pytest
import warp as wp

from warp_neural import MLP, InputError
from warp_neural.coopvec import check_combination, combination_table, supported_combinations
from warp_neural.kernels.nn.spec import FORMATS, NetworkSpec


def test_combinations(device):
    """All that a network takes and nothing else; tensor cores multiply what the architecture has."""
    combinations = supported_combinations(device)
    assert len(combinations) == len(set(combinations)) == 26
    for c in combinations:
        oldest = FORMATS[c.input_interpretation].min_arch
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
]


@pytest.mark.parametrize(("arguments", "reason"), REFUSED)
def test_unsupported_combination_shows_the_table(arguments, reason, device):
    table = combination_table(device)
    assert len({len(line) for line in table.splitlines()}) == 1
    with pytest.raises(InputError, match=reason) as error:
        check_combination(*arguments, device=device)
    assert str(error.value).endswith(table)


def test_supported_combinations_pass(device):
    for c in supported_combinations(device):
        accumulation = c.accumulation.replace("int32", "float32")
        check_combination(
            c.input_interpretation, accumulation, getattr(wp, c.input_type), c.bias_interpretation, device
        )


def test_networks_refuse_in_one_line():
    with pytest.raises(InputError, match="tf32 accumulates in float32 only; float16, e4m3") as error:
        MLP(3, 2, precision="tf32", accumulation="float16", device="cpu")
    assert "\n" not in str(error.value)
