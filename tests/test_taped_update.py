"""Steps of a `Trainer` whose encoding has parameters: those without a gradient rest, all others move."""

import numpy as np
import pytest
import reference_update as reference
import warp as wp

import warp_neural as wn
from warp_neural import encodings
from warp_neural.train.optim import SGD, Adam

GRID = encodings.HashGrid(3, log2_size=7, base_resolution=4, initial=(0.0, 1.0))
SPARSE = encodings.Concatenate((encodings.Frequency(2), GRID))
DENSE = encodings.Concatenate((encodings.LatentTexture(5, 5, 3), GRID))  # ends between two multiples of 4


@wp.func
def wave(index: int, random: wn.random.Stream):
    numbers = wn.random.uniform(random, 0)
    u, v = numbers[0], numbers[1]
    return wp.vec2(u, v), wp.vec3(u, u * v, wp.sin(9.0 * v))


def trainer(device, encoding=SPARSE, **options):
    net = wn.MLP(2, 3, 16, 1, encoding=encoding, device=device, precision="float16", seed=2)
    return wn.Trainer(net, sample=wave, batch=4, **options)


def state(run):
    return [a.numpy().copy() for a in (run.net.master, run.options.first, run.options.second)]


@pytest.mark.parametrize(
    "kind, encoding, fused",
    [("adam", SPARSE, None), ("sgd", SPARSE, None), ("adam", SPARSE, False), ("adam", DENSE, None)],
    ids=["adam", "sgd", "taped", "dense"],
)
def test_steps(device, kind, encoding, fused):
    """2e-5: the power of beta2 and the square of the gradient are rounded to float32."""
    optimizer = Adam(lr=1e-2, weight_decay=0.1) if kind == "adam" else SGD(lr=1e-2, momentum=0.9)
    run = trainer(device, encoding, optimizer=optimizer, batches=2, average=0.99, fused=fused)
    start = run.net.encoding_start if encoding is SPARSE else run.net.master.size
    truth = reference.Run(run.net.master.numpy(), start)
    reached, rested = np.zeros(run.net.master.size, bool), False
    for _ in range(4):
        g = run.gradient()
        before = state(run)
        run.run(1, quiet=True)
        truth.adam(g, 1e-2, decay=0.1) if kind == "adam" else truth.sgd(g, 1e-2, 0.9)
        resting = (g == 0) & (np.arange(len(g)) >= start)
        for old, new in zip(before, state(run), strict=True):
            assert (old[resting] == new[resting]).all()
        rested |= (resting & reached).any()  # with moments that would have moved it
        reached |= g != 0
        np.testing.assert_allclose(run.net.master.numpy(), truth.values, rtol=2e-5, atol=1e-7)
        assert not run.net.gradient.numpy().any()
    assert rested == (encoding is SPARSE) and not reached.all()
    np.testing.assert_allclose(run.averaged, truth.average, rtol=2e-5, atol=1e-7)


def test_large_table_without_an_average(device):
    """Of 2^15 parameters few are reached; the others are passed over, to the last one."""
    grid = encodings.HashGrid(1, log2_size=14, base_resolution=128)
    run = trainer(device, grid, optimizer=SGD(lr=1.0))
    for _ in range(2):
        before, g = run.net.master.numpy().copy(), run.gradient()
        assert 0 < np.count_nonzero(g[run.net.encoding_start :]) <= 4 * 4 * 2
        run.run(1, quiet=True)
        np.testing.assert_allclose(run.net.master.numpy(), before - g, rtol=1e-6, atol=1e-7)


def test_skipped_step_leaves_no_trace(device):
    run = trainer(device, loss_scale=3e38, average=0.9)
    before = state(run)
    run.run(1, quiet=True)
    assert run.skipped == 1 and not run.net.gradient.numpy().any()
    for old, new in zip(before, state(run), strict=True):
        assert (old == new).all()


def test_resumes_bit_for_bit(tmp_path):
    """On the CPU; CUDA adds gradients of tables in no fixed order."""
    run = trainer("cpu", average=0.99)
    run.run(3, quiet=True)
    run.save(tmp_path / "run.safetensors")
    run.run(4, quiet=True)
    again = trainer("cpu", average=0.99)
    again.load(tmp_path / "run.safetensors")
    again.run(4, quiet=True)
    for a, b in zip([*state(run), run.averaged], [*state(again), again.averaged], strict=True):
        assert (a == b).all()
