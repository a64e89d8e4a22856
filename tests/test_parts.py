"""Encodings by parts of the results and lanes of a warp, as a CUDA trainer runs them, against float64."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from networks import error
from reference_encodings import expected
from trainers import trainer

import warp_neural as wn
from warp_neural import encodings
from warp_neural.kernels.nn.encodings.parts import make_adjoint_part, make_encode_part, vec_part
from warp_neural.kernels.nn.spec import Parameters

GRID = encodings.HashGrid(8, 2, log2_size=13, base_resolution=4, growth=1.7)  # 2 parts; 6 levels in 2D have shared sums
CASES = [
    (GRID, 2),
    (encodings.HashGrid(5, 3, log2_size=11, base_resolution=4, growth=1.5), 3),  # in one part
    (encodings.HashGrid(8, 1, log2_size=13, base_resolution=4, growth=1.7), 4),
    (encodings.HashGrid(4, 4, log2_size=7), 1),
    (encodings.HashGrid(2, 2, log2_size=13, base_resolution=80), 2),  # none has
    (encodings.LatentTexture(5, 4, 8), 2),
    (encodings.Concatenate((encodings.Frequency(2), GRID, encodings.Identity()), ((2,), (1, 0), (0, 2))), 3),
]
PLACE = 1e-5  # error of a place in the finest of these grids, 164 cells a side, by rounding to float32
each_case = pytest.mark.parametrize(("encoding", "n_in"), CASES, ids=[f"{type(e).__name__}-{n}" for e, n in CASES])


@cache
def make_kernel(leaf, n_in: int) -> wp.Kernel:
    """One thread after the other is each lane of each part."""
    vec_in, vec_out = wp.types.vector(n_in, float), vec_part(leaf)
    encode, adjoint = make_encode_part(leaf, vec_in, 4), make_adjoint_part(leaf, vec_in, 4)
    lanes = leaf.encoding.lanes

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(params: Parameters, x: wp.array[vec_in], dy: wp.array2d[vec_out], y: wp.array2d[vec_out]):
        i, part = wp.tid()
        for lane in range(lanes):
            y[i, part] += encode(params, x[i], part, lane)
            adjoint(params, x[i], dy[i, part], part, lane)

    return kernel


@pytest.mark.parametrize(("encoding", "n_in"), [*CASES[:2], CASES[5]], ids=["4 levels", "all levels", "texels"])
def test_shares_and_lanes(encoding, n_in):
    """On the CPU, where lanes do not add up by themselves, and shared sums are left out."""
    rng, (leaf,) = np.random.default_rng(0), encoding.leaves(n_in)
    x, n = rng.uniform(0, 1, (50, n_in)).astype(np.float32), encoding.n_parameters(n_in)
    master = rng.normal(size=n + 4).astype(np.float32)
    dy = rng.normal(size=(50, encoding.n_out(n_in))).astype(np.float32)
    params, vec = Parameters(), vec_part(leaf)
    params.master = wp.array(master, dtype=float, device="cpu", requires_grad=True)
    encoded = wp.array(dy.reshape(50, leaf.encoding.n_parts, -1), dtype=vec, device="cpu")
    y, points = wp.zeros_like(encoded), wp.array(x, dtype=wp.types.vector(n_in, float), device="cpu")
    wp.launch(make_kernel(leaf, n_in), encoded.shape, [params, points, encoded, y], device="cpu")
    exact = x.astype(np.float64), master[4:].astype(np.float64)
    assert error(y.numpy().reshape(dy.shape), expected(encoding, *exact)) < PLACE
    gradient, shared_sums = expected(encoding, *exact, dy.astype(np.float64)), encoding.shared_sums(n_in)
    assert error(params.master.grad.numpy()[4 + shared_sums :], gradient[shared_sums:]) < PLACE
    assert not params.master.grad.numpy()[: 4 + shared_sums].any()


def test_what_has_shared_sums():
    """Tables of at most 4096 entries, as long as they fit in 46 KB."""
    assert encodings.HashGrid().shared_sums(2) == 2 * (256 + 1024 + 4096)
    assert GRID.shared_sums(2) == sum(2 * table.size for table in GRID.tables(2)[:6]) < GRID.n_parameters(2)
    assert encodings.HashGrid(16, 4, base_resolution=20).shared_sums(2) == 4 * (400 + 1600)
    assert CASES[4][0].shared_sums(2) == 0


def check_encoded_batch(encoding, n_in, device, precision="float16", n=333):
    """Of the kernels around the fused one, for fewer samples than there is memory; returns both relative errors."""
    rng = np.random.default_rng(0)
    net = wn.MLP(n_in, 3, 32, 2, encoding=encoding, device=device, precision=precision)
    run, x, _ = trainer(net, n, batch=n + 100)
    launches, x = run.launches, np.abs(x)
    launches.data.x.assign(x)
    run.progress.batch.fill_(n)
    net.master.assign(rng.normal(size=net.master.size).astype(np.float32))
    exact = x.astype(np.float64), net.master.numpy()[net.encoding_start :].astype(np.float64)
    inputs = [net.plain, launches.data, run.progress, 0]
    batch = launches.encoded_batch
    batch.encode(inputs)
    encoded = batch.values.numpy()
    assert not encoded[n:].any()
    dy = rng.normal(size=encoded.shape).astype(encoded.dtype)
    batch.values.assign(dy)
    net.gradient.zero_()
    batch.adjoint(inputs)
    gradient = net.gradient.numpy()
    assert not gradient[: net.encoding_start].any()
    expected_gradient = expected(encoding, *exact, dy[:n].astype(np.float64))
    return error(encoded[:n], expected(encoding, *exact)), error(gradient[net.encoding_start :], expected_gradient)


@each_case
@pytest.mark.parametrize("precision", ["float16", "bfloat16"])  # encoded to float16 and to float32
def test_encoded_batch(encoding, n_in, precision, device):
    """float16 keeps 11 bits; all else is float32."""
    if device.is_cpu:
        pytest.skip("the CPU has no kernels around the fused one")
    values, gradient = check_encoded_batch(encoding, n_in, device, precision)
    assert values < (4e-4 if precision == "float16" else PLACE)
    assert gradient < PLACE
