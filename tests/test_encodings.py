"""Encodings: values, gradients through a tape, and the parameters' gradient by itself, against float64."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from reference_encodings import expected

from warp_neural import InputError
from warp_neural.kernels.nn.encodings import (
    Concatenate,
    Encoding,
    Frequency,
    HashGrid,
    Identity,
    LatentTexture,
    OneBlob,
    Scaled,
    SphericalHarmonics,
    TriangleWave,
)
from warp_neural.kernels.nn.spec import Parameters

MIXED = Concatenate(
    (Frequency(2), LatentTexture(3, 2, 3), Concatenate((Identity(), LatentTexture(2, 2, 4, wrap=True)))),
    ((2,), (2, 0), (1, 0)),
)
CASES = [
    (Identity(), 3),
    (Frequency(1), 1),
    (Frequency(4, lowest=2.0), 2),
    (Frequency(5), 5),  # 25 angles: more than one vector, and not a whole number of them
    (TriangleWave(5), 2),
    (OneBlob(7), 2),
    (OneBlob(1), 1),
    (SphericalHarmonics(8), 3),
    (LatentTexture(5, 4, 3), 2),
    (LatentTexture(1, 3, 1), 2),
    (LatentTexture(5, 4, 8, wrap=True), 2),
    (HashGrid(3, 2, log2_size=4, base_resolution=4), 1),  # each has dense and hashed levels
    (HashGrid(4, 2, log2_size=6, base_resolution=4, growth=1.5), 2),
    (HashGrid(4, 4, log2_size=8, base_resolution=4, growth=1.5), 3),
    (HashGrid(2, 3, log2_size=9, base_resolution=4), 4),
    (MIXED, 3),
    (Scaled(MIXED, 0.5, 0.25), 3),
    (Concatenate((Scaled(SphericalHarmonics(3), 2.0, -1.0), Scaled(Identity(), 0.0, 1.0))), 3),
]
each_case = pytest.mark.parametrize(("encoding", "n_in"), CASES, ids=[f"{type(e).__name__}-{n}" for e, n in CASES])
OFFSET, PAD = 4, 8  # floats before the first network's parameters, and between networks


def derivative(encoding: Encoding, x: np.ndarray, parameters: np.ndarray, dy: np.ndarray, step=1e-6) -> np.ndarray:
    """Of sum(dy * y) in x, by central differences."""
    shifts = np.eye(x.shape[1]) * step
    differences = [expected(encoding, x + s, parameters) - expected(encoding, x - s, parameters) for s in shifts]
    return np.stack([(d * dy).sum(axis=1) / (2 * step) for d in differences], axis=1)


@cache
def make_kernels(encoding: Encoding, n_in: int) -> tuple[wp.Kernel, wp.Kernel | None]:
    stride = encoding.n_parameters(n_in) + PAD
    encode, adjoint = encoding.make(n_in, OFFSET, stride), encoding.make_adjoint(n_in, OFFSET, stride)
    vec_in, vec_out = wp.types.vector(n_in, float), wp.types.vector(encoding.n_out(n_in), float)

    @wp.kernel(module="unique")
    def encode_kernel(params: Parameters, x: wp.array[vec_in], y: wp.array[vec_out]):
        i = wp.tid()
        y[i] = encode(params, x[i])

    if adjoint is None:
        return encode_kernel, None

    @wp.kernel(module="unique", enable_backward=False)
    def adjoint_kernel(params: Parameters, x: wp.array[vec_in], dy: wp.array[vec_out]):
        i = wp.tid()
        adjoint(params, x[i], dy[i])

    return encode_kernel, adjoint_kernel


class Run:
    """Values and gradients of network 1 of two, at points `x` `[n, n_in]`."""

    def __init__(self, encoding: Encoding, x: np.ndarray, device: wp.Device):
        n_in, rng = x.shape[1], np.random.default_rng(1)
        n = encoding.n_parameters(n_in)
        forward, adjoint = make_kernels(encoding, n_in)
        master = rng.normal(size=OFFSET + 2 * (n + PAD)).astype(np.float32)
        self.own = slice(OFFSET + n + PAD, OFFSET + 2 * n + PAD)
        self.parameters = master[self.own].astype(np.float64)
        self.dy = rng.normal(size=(len(x), encoding.n_out(n_in))).astype(np.float32)
        params = Parameters()
        params.packed = wp.zeros(1, dtype=wp.uint32, device=device)
        params.network, params.master = 1, wp.array(master, dtype=float, device=device, requires_grad=True)
        inputs = wp.array(x, dtype=wp.types.vector(n_in, float), device=device, requires_grad=True)
        vec_out = wp.types.vector(encoding.n_out(n_in), float)
        y = wp.zeros(len(x), dtype=vec_out, device=device, requires_grad=True)
        with wp.Tape() as tape:
            wp.launch(forward, len(x), [params, inputs, y], device=device)
        y.grad.assign(self.dy)
        tape.backward()
        self.y, self.dx, self.taped = y.numpy(), inputs.grad.numpy(), params.master.grad.numpy().copy()
        if adjoint is not None:
            params.master.grad.zero_()
            dy = wp.array(self.dy, dtype=vec_out, device=device)
            wp.launch(adjoint, len(x), [params, inputs, dy], device=device)
            self.direct = params.master.grad.numpy()


def points(encoding: Encoding, n_in: int) -> np.ndarray:
    x = np.random.default_rng(0).uniform(0, 1, (200, n_in))
    if isinstance(encoding, SphericalHarmonics):
        x = 2 * x - 1
        x /= np.linalg.norm(x, axis=1, keepdims=True)
    return x.astype(np.float32)


@each_case
def test_values_and_gradients(encoding, n_in, device):
    """2e-6 of the largest: a few roundings of float32, of a place in the finest grid or of terms that cancel."""
    x = points(encoding, n_in)
    run, exact = Run(encoding, x, device), x.astype(np.float64)
    y = expected(encoding, exact, run.parameters)
    np.testing.assert_allclose(run.y, y, rtol=0, atol=2e-6 * np.abs(y).max())
    dx = derivative(encoding, exact, run.parameters, run.dy)
    np.testing.assert_allclose(run.dx, dx, rtol=0, atol=5e-6 * max(np.abs(dx).max(), 1))
    gradient = np.zeros_like(run.taped)
    gradient[run.own] = expected(encoding, exact, run.parameters, run.dy.astype(np.float64))
    np.testing.assert_allclose(run.taped, gradient, rtol=0, atol=5e-6 * max(np.abs(gradient).max(), 1))
    if encoding.n_parameters(n_in):
        np.testing.assert_allclose(run.direct, run.taped, rtol=0, atol=1e-6 * np.abs(gradient).max())


@pytest.mark.parametrize("lowest", [1.0, 2.0])
def test_frequency_far_from_zero(lowest, device):
    """The angle is reduced before pi enters: a thousand periods out, its rounding has not grown."""
    x = np.random.default_rng(0).uniform(-1000, 1000, (200, 2)).astype(np.float32)
    encoding = Frequency(4, lowest)
    y = Run(encoding, x, device).y
    np.testing.assert_allclose(y, expected(encoding, x.astype(np.float64), None), rtol=0, atol=1e-6)


def test_courses_encoding(device):
    """Step 4: sine and cosine of 2 pi 2^k x, k = 0 to 3."""
    y = Run(Frequency(4, lowest=2.0), np.float32([[0.125, 0.75]]), device).y
    r = np.sqrt(0.5)
    np.testing.assert_allclose(y[0], [r, r, 1, 0, 0, -1, 0, 1, -1, 0, 0, -1, 0, 1, 0, 1], rtol=0, atol=1e-6)


@pytest.mark.parametrize(("wrap", "u", "texel"), [(False, 1.7, 4), (False, -0.3, 0), (True, 1.7, 3), (True, -0.9, 0)])
def test_texture_outside(wrap, u, texel, device):
    """Clamped, the nearest edge, where the derivative is 0; wrapped, the texel whose centre is a period away."""
    encoding = LatentTexture(5, 4, 8, wrap) if wrap else LatentTexture(5, 4, 3)
    v = np.float32(1.5 / 4 if wrap else 1 / 3)
    run = Run(encoding, np.array([[u, v]], np.float32), device)
    texels = run.parameters.reshape(4, 5, -1)
    np.testing.assert_allclose(run.y[0], texels[1, texel], rtol=0, atol=4e-6)
    assert wrap or run.dx[0, 0] == 0


def test_texture_corners_of_the_unit_square(device):
    encoding = LatentTexture(5, 4, 3)
    run = Run(encoding, np.float32([[0, 0], [1, 0], [0, 1], [1, 1]]), device)
    np.testing.assert_allclose(run.y, run.parameters.reshape(4, 5, 3)[[0, 0, 3, 3], [0, 4, 0, 4]], rtol=0, atol=1e-6)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30])
def test_any_input_stays_in_bounds(value, device):
    """The gradient lands in the network's own parameters, though the values mean nothing."""
    for encoding in (LatentTexture(5, 4, 3), LatentTexture(5, 4, 8, wrap=True), CASES[12][0]):
        run = Run(encoding, np.array([[value, 0.5], [0.5, value]], np.float32), device)
        run.taped[run.own] = run.direct[run.own] = 0
        assert not run.taped.any() and not run.direct.any()


def test_default_hash_grid_is_tiny_cuda_nns():
    """16 levels of 2 features: in 2D the sixth, 512 x 512, is the last of tables for every vertex but 2^19 entries."""
    grid = HashGrid()
    sizes = [table.size for table in grid.tables(2)]
    assert sizes == [256, 1024, 4096, 16384, 65536, 262144, *[2**19] * 10]
    assert [table.hashed for table in grid.tables(2)] == [False] * 6 + [True] * 10
    assert grid.n_parameters(2) == 2 * sum(sizes)
    assert grid.n_out(2) == 32 and grid.initial == (-1e-4, 1e-4)


@pytest.mark.parametrize(
    ("growth", "sizes"),
    [
        (2 ** (1 / 3), [16, 40, 56, 88, 128, 176, 296, 448, 680, 1096]),
        (4 ** (1 / 7), [16, 32, 40, 64, 88, 128, 200, 296, 400, 576]),
        (3 ** (1 / 5), [16, 32, 56, 64, 104, 176, 232, 368, 576, 848]),
        (1.5, [16, 40, 88, 200, 448, 968, 2120, 4768, 10616, 23720]),
    ],
)
def test_sizes_of_roots_are_tiny_cuda_nns(growth, sizes):
    """Those of its `grid_scale` and `grid_resolution` in float32: 8 vertices become 8.000001, and so 9."""
    assert [table.size for table in HashGrid(levels=10, growth=growth, base_resolution=4).tables(2)] == sizes


def test_harmonics_are_orthonormal(device):
    """By Gauss-Legendre quadrature, exact for these products."""
    z, weights = np.polynomial.legendre.leggauss(16)
    phi = np.arange(32) * np.pi / 16
    r = np.sqrt(1 - z**2)[:, None]
    x = np.stack([r * np.cos(phi), r * np.sin(phi), np.broadcast_to(z[:, None], (16, 32))], axis=-1).reshape(-1, 3)
    y = Run(SphericalHarmonics(8), x.astype(np.float32), device).y.astype(np.float64)
    gram = (y * np.repeat(weights, 32)[:, None] * np.pi / 16).T @ y
    np.testing.assert_allclose(gram, np.eye(64), rtol=0, atol=5e-6)


def test_concatenation_of_initial_ranges():
    assert Concatenate((Frequency(), LatentTexture(2, 2))).initial == (0.0, 1.0)
    assert Concatenate((HashGrid(), LatentTexture(2, 2, initial=(-1e-4, 1e-4)))).initial == (-1e-4, 1e-4)


@pytest.mark.parametrize(("encoding", "n_in"), [CASES[i] for i in (2, 4, 5, 7, 12, 15)], ids=lambda v: type(v).__name__)
@pytest.mark.parametrize("arch", [75, 90])
def test_compiles_for_cuda(encoding, n_in, arch, tmp_path):
    """Before and after additions of whole vectors to memory."""
    for kernel in make_kernels(encoding, n_in):
        if kernel:
            (artifact,) = wp.compile_aot_module(kernel.module, arch=arch, module_dir=tmp_path)
            assert artifact.stat().st_size > 0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Frequency(0), "octaves=0"),
        (lambda: Frequency(2, -1.0), "lowest"),
        (lambda: TriangleWave(40), "octaves=40"),
        (lambda: OneBlob(0), "bins=0"),
        (lambda: SphericalHarmonics(9), "degree=9"),
        (lambda: SphericalHarmonics(2).make(2), "n_in=2: expected a whole number of 3 to 3"),
        (lambda: LatentTexture(0, 2), "width=0"),
        (lambda: LatentTexture(2, 2).make(3), "n_in=3"),
        (lambda: HashGrid(growth=0.5), "growth=0.5"),
        (lambda: HashGrid(levels=40), "levels"),
        (lambda: HashGrid().make(5), "n_in=5: expected a whole number of 1 to 4"),
        (lambda: HashGrid(levels=2.5), "levels=2.5: expected a whole number"),
        (lambda: HashGrid(growth="2"), "growth='2': expected a number >= 1"),
        (lambda: HashGrid(initial=(1.0, -1.0)), "initial"),
        (lambda: LatentTexture(2, 2, initial=0.5), "initial=0.5: expected a range"),
        (lambda: OneBlob(None), "bins=None"),
        (lambda: Frequency(2, float("inf")), "lowest=inf"),
        (lambda: Concatenate(()), "at least one"),
        (lambda: Concatenate([Identity()]), "a tuple of encodings"),
        (lambda: Concatenate((Identity(),), (0,)), "a tuple of indices"),
        (lambda: Concatenate((HashGrid(), LatentTexture(2, 2))), "initial"),
        (lambda: Concatenate((Identity(),), ((0,), (1,))), "one a part"),
        (lambda: Concatenate((Identity(),), ((3,),)).make(2), "of 2"),
    ],
)
def test_bad_arguments(make, message):
    with pytest.raises(InputError, match=message) as error:
        make()
    assert "\n" not in str(error.value)
