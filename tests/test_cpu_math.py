"""Functions of 16 floats at a time against float64: `kernels.coopvec.cpu.math`."""

from math import erf

import numpy as np
import pytest
import warp as wp

from warp_neural.kernels.coopvec.cpu.math import FUNCTIONS, MATH, on_vectors
from warp_neural.kernels.coopvec.cpu.network import PRELUDE
from warp_neural.kernels.nn import activations

EXACT = {"exp": np.exp, "log": np.log, "tanh": np.tanh, "erf": np.vectorize(erf, otypes=[float]), "sin": np.sin}
EXACT |= {"cos": np.cos, "sqrt": np.sqrt, "abs": np.abs}
SPECIAL = [0.0, -0.0, np.inf, -np.inf, np.nan, 1e-40, 88.7, 89.5, -87.5, -103.0, -105.0, 3.4e38, -1.0, 1.0, 0.625, 4.0]


def make_kernel(name: str) -> wp.Kernel:
    text = f"const v16 z = load(x.data + i); store(y.data + i, {on_vectors(f'wp::{name}(z)')});"

    @wp.func_native(f"{PRELUDE}{MATH}for (int i = 0; i < x.shape[0]; i += 16) {{ {text} }}\n")
    def evaluate(x: wp.array[float], y: wp.array[float]): ...

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(x: wp.array[float], y: wp.array[float]):
        evaluate(x, y)

    return kernel


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_within_four_units_in_the_last_place(name):
    rng = np.random.default_rng(0)
    ranges = [rng.uniform(-s, s, 4096) for s in (1e-3, 0.7, 3, 10, 100, 20000)]
    x = np.concatenate([*ranges, 10.0 ** rng.uniform(-44, 38, 4096), SPECIAL]).astype(np.float32)
    y = wp.zeros(len(x), dtype=float, device="cpu")
    wp.launch(make_kernel(name), 1, [wp.array(x, dtype=float, device="cpu"), y], device="cpu")
    with np.errstate(all="ignore"):
        exact = EXACT[name](x.astype(np.float64))
        expected = exact.astype(np.float32)
    finite = np.isfinite(expected)
    np.testing.assert_array_equal(y.numpy()[~finite], expected[~finite])
    unit = np.spacing(np.maximum(np.abs(expected), np.float32(1e-37)))
    if name in ("sin", "cos"):  # near their zeros far from 0 the reduction keeps an absolute error
        unit = np.maximum(unit, np.spacing(np.float32(0.3)))
    assert (np.abs(y.numpy()[finite] - exact[finite]) / unit[finite]).max() < 4


def test_unknown_functions_are_left_alone():
    assert on_vectors("z > 0.0f ? z : 0.0f") == "z > 0.0f ? z : 0.0f"
    assert on_vectors("wp::exp(z) + wp::atan(z)") is None


def test_what_vectors_have_no_expression_for():
    """Comparisons as numbers, other functions, double precision: those activations go one float at a time."""
    for text in ("(z > 0.0f) * z", "z * 0.5", "1e-3 * z", "fmaxf(z, 0.0f)", "wp::max(z, 0.0f)", "float(z > 0.0f)"):
        assert on_vectors(text) is None, text
    for text in ("z > 0.0f ? z : 2 * z", "1e-3f * z", "wp::exp(z)", *(a.value for a in activations.ALL)):
        assert on_vectors(text), text
