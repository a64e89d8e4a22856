"""Initial weights: of the stated variance and bounds, from the seed alone, the same on every device."""

import numpy as np
import pytest

from warp_neural import MLP, InputError
from warp_neural.nn.initialization import he_normal, he_uniform, xavier_normal, xavier_uniform

N_OUT, N_IN = 200, 300
VARIANCES = {
    xavier_uniform: 2 / (N_IN + N_OUT),  # Glorot and Bengio 2010, eq. 16
    xavier_normal: 2 / (N_IN + N_OUT),
    he_uniform: 2 / N_IN,  # He et al. 2015, eq. 10
    he_normal: 2 / N_IN,
}
each = pytest.mark.parametrize("initialization", VARIANCES, ids=lambda f: f.__name__)


@each
def test_moments(initialization):
    """Within 4 standard deviations of the mean of n^2, and of n, over the 60,000 numbers."""
    weights, variance = initialization(np.random.default_rng(0), N_OUT, N_IN), VARIANCES[initialization]
    assert weights.shape == (N_OUT, N_IN)
    uniform = "uniform" in initialization.__name__
    kurtosis = 9 / 5 if uniform else 3
    assert abs(weights.mean()) < 4 * np.sqrt(variance / weights.size)
    assert abs((weights**2).mean() / variance - 1) < 4 * np.sqrt((kurtosis - 1) / weights.size)
    assert abs((weights**4).mean() / variance**2 / kurtosis - 1) < 0.05
    if uniform:
        bound = np.sqrt(3 * variance)
        assert 0.999 * bound < np.abs(weights).max() <= bound


@each
def test_seed_alone_decides(initialization, device):
    def net(seed: int, where) -> np.ndarray:
        return MLP(3, 2, width=16, depth=2, initialization=initialization, seed=seed, device=where).master.numpy()

    np.testing.assert_array_equal(net(1, device), net(1, "cpu"))
    assert (net(1, device) != net(2, device)).any()


@each
def test_networks_of_one_shape_differ(initialization):
    net = MLP(3, 2, width=16, depth=2, initialization=initialization, count=2, device="cpu")
    assert all((w[0] != w[1]).any() for w in net.weights)
    assert not any(b.any() for b in net.biases)


@pytest.mark.parametrize(
    ("own", "message"),
    [
        (lambda rng, n_out, n_in: rng.random(3), r"gave shape \(3,\); expected \[n_out, n_in\], here \(16, 3\)"),
        (lambda rng, n_out, n_in: rng.random((n_in, n_out)), r"gave shape \(3, 16\)"),
        (lambda rng, n_out, n_in: 0.5, r"gave shape \(\)"),
        (lambda rng, n_out, n_in: np.full((n_out, n_in), np.nan), "gave numbers that are not finite"),
        (lambda rng, n_out, n_in: [["a"] * n_in] * n_out, "could not convert string"),
        (lambda rng: rng.random(3), "takes 1 positional argument"),
    ],
)
def test_what_gives_no_matrix_is_refused(own, message):
    with pytest.raises(InputError, match=f"^initialization: .*{message}"):
        MLP(3, 2, width=16, depth=2, initialization=own, device="cpu")
