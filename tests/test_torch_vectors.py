"""The modules against tiny-cuda-nn's own results, from its own parameters: outputs, gradients, initial values."""

import numpy as np
import pytest
import warp as wp
from tcnn_vectors import ARRAYS, RECORDS, vectors
from torch_modules import gradients, make

from warp_neural import InputError

REFUSED = {
    "dense3d_smoothstep": "interpolation 'Smoothstep' is not supported; the nearest is 'Linear'",
    "hash2d_smoothstep": "interpolation 'Smoothstep' is not supported; the nearest is 'Linear'",
    "hash3d_nearest": "interpolation 'Nearest' is not supported; the nearest is 'Linear'",
    "tiled2d": "otype 'TiledGrid' is not supported; the nearest is a HashGrid",
}
NOT_RECORDED = {"act_ff_sine"}  # tiny-cuda-nn itself refuses it; here it is one more activation

# largest errors, as shares of the norm. Of fp32: y and dx by its fast sine, else roundings
FP32, FP16 = 1e-5, 1e-3
# its fast exponentials shift the scales of grids: by 5e-4 of 7006 in the finest of 16 levels that grow by 1.5
SHIFTED = {"hash2d_fp32": 1e-3, "hash3d_fp32": 3e-5, "hash2d_fp16": 1e-3, "hash3d_fp16": 3e-5}
NETWORK, KINKS = 2.5e-3, 3.5e-2
ROW = 1e-2
# rows whose dx is off by more: on a fold of the wave, in another cell, a unit on the other side of ReLU's kink
OTHER_ROWS = {"trianglewave_fp32": 1, "trianglewave_fp16": 1, "hash2d_fp32": 1, "hash2d_fp16": 1}
KINK_ROWS = 6


def names(refused: bool) -> list[str]:
    return [name for name in RECORDS if name not in NOT_RECORDED and (name.rpartition("_")[0] in REFUSED) == refused]


def off(result: np.ndarray, expected: np.ndarray) -> float:
    """As a share of the norm."""
    return np.linalg.norm(result - expected) / np.linalg.norm(expected)


def bends(record: dict) -> bool:
    """Whether a unit's slope jumps."""
    network = record.get("network") or {}
    return {network.get("activation"), network.get("output_activation")} & {"ReLU", "LeakyReLU"} != set()


@pytest.mark.parametrize("name", names(False))
def test_results_are_tiny_cuda_nns(name, device):
    """float16 by its rounding, 5e-4 of a number, once or a few times."""
    expected = vectors(name)
    record, module = expected.record, make(expected.record).to(wp.device_to_torch(device))
    module.load_tcnn_params(expected.params)
    y, dx, dparams = gradients(module, expected.x, expected.dy)
    least = FP16 if record["param_precision"] == "fp16" else FP32
    assert off(y, expected.y) < max(least, SHIFTED.get(name, 0))

    read = ~np.isnan(expected.dx).all(axis=0)
    assert not dx[:, ~read].any(), "inputs that no part reads"
    dx, exact = dx[:, read], expected.dx[:, read]
    others = np.linalg.norm(dx - exact, axis=1) > ROW * np.linalg.norm(exact, axis=1)
    assert others.sum() <= (KINK_ROWS if bends(record) else OTHER_ROWS.get(name, 0))
    share = NETWORK if record["kind"] != "encoding" else max(FP32, SHIFTED.get(name, 0))
    assert off(dx[~others], exact[~others]) < share

    if record["n_params"]:
        exact_dparams = module.order.take(expected.dparams)
        fill_columns(module, dparams)
        limit = least if record["kind"] == "encoding" else KINKS if bends(record) else NETWORK
        assert off(dparams, exact_dparams) < max(limit, SHIFTED.get(name, 0))


def fill_columns(module, gradient: np.ndarray) -> None:
    """A bias in place of columns of ones has the gradient of each; `Order.take` sums theirs."""
    if module.shape.spec:
        (k, n), columns = module.shape.spec.layers[0], module.order.matrices[0][1]
        gradient[n * k : n * k + n] *= columns - k


@pytest.mark.parametrize("name", names(True))
def test_others_are_refused_by_name(name):
    with pytest.raises(InputError) as error:
        make(RECORDS[name])
    assert str(error.value) == f"encoding_config: {REFUSED[name.rpartition('_')[0]]}"


@pytest.mark.parametrize("name", ["net_density", "mlp_ff_32_64x2_16"])
def test_initial_values_are_tiny_cuda_nns(name):
    """Matrices bit for bit; its grids by one rounding."""
    record, expected = RECORDS[name], ARRAYS[f"{name}/init_1337"]
    module = make(record)
    values, n = module.order.initial(module.seed), record["n_network_params"]
    np.testing.assert_array_equal(values[:n], expected[:n])
    np.testing.assert_allclose(values[n:], expected[n:], rtol=0, atol=1e-11)
    np.testing.assert_array_equal(module.params.detach().numpy(), module.order.take(values))


@pytest.mark.parametrize("name", ["mlp_ff_5_32x2_3", "net_sh3", "net_hash_pad", "composite_hash_sh_fp32"])
def test_parameters_return_to_tiny_cuda_nn(name):
    """The same function: what has no effect is 0, and columns of ones are one column."""
    module = make(RECORDS[name])
    module.load_tcnn_params(vectors(name).params)
    ours = module.params.detach().numpy().copy()
    given = module.tcnn_params()
    assert given.shape == (RECORDS[name]["n_params"],)
    module.load_tcnn_params(given)
    np.testing.assert_array_equal(module.params.detach().numpy(), ours)
