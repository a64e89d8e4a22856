"""Philox4x32-10 against its authors' vectors and NumPy; no two samples share numbers, whatever they are for."""

import numpy as np
import pytest
import warp as wp

import warp_neural as wn
from warp_neural.kernels.nn.random import philox, stream, uniform

# counter, key and result: kat_vectors of Random123 1.09
VECTORS = [
    ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
]


@wp.kernel(enable_backward=False)
def philox_kernel(words: wp.array2d[wp.uint32], results: wp.array2d[wp.uint32]):
    i = wp.tid()
    w = words[i]
    a, b, c, d = philox(w[0], w[1], w[2], w[3], w[4], w[5])
    results[i, 0] = a
    results[i, 1] = b
    results[i, 2] = c
    results[i, 3] = d


@wp.kernel(enable_backward=False)
def uniform_kernel(seed: wp.uint64, step: int, purpose: int, results: wp.array2d[wp.vec4]):
    i, block = wp.tid()
    results[i, block] = uniform(stream(seed, step, i, purpose), block)


def words(text: str) -> list[int]:
    return [int(word, 16) for word in text.split()]


def numbers(device, seed=0, step=0, purpose=0, n=1000, blocks=2):
    results = wp.zeros((n, blocks), dtype=wp.vec4, device=device)
    wp.launch(uniform_kernel, results.shape, inputs=[seed, step, purpose], outputs=[results], device=device)
    return results.numpy()


def reference(counters, key):
    """Of [n, 4] and two words: [n, 4]."""
    c, k = np.asarray(counters, np.uint64).T.copy(), list(map(int, key))
    mask = np.uint64(0xFFFFFFFF)
    for _ in range(10):
        p, q = c[0] * np.uint64(0xD2511F53), c[2] * np.uint64(0xCD9E8D57)
        p_high, q_high = p >> np.uint64(32), q >> np.uint64(32)
        c = np.stack([q_high ^ c[1] ^ np.uint64(k[0]), q & mask, p_high ^ c[3] ^ np.uint64(k[1]), p & mask])
        k = [(k[0] + 0x9E3779B9) & 0xFFFFFFFF, (k[1] + 0xBB67AE85) & 0xFFFFFFFF]
    return c.T


def test_vectors_of_the_authors(device):
    given = np.array([words(counter) + words(key) for counter, key, _ in VECTORS], np.uint32)
    expected = np.array([words(result) for *_, result in VECTORS])
    results = wp.zeros((3, 4), dtype=wp.uint32, device=device)
    inputs = [wp.array(given, dtype=wp.uint32, device=device), results]
    wp.launch(philox_kernel, 3, inputs=inputs, device=device)
    np.testing.assert_array_equal(results.numpy(), expected)
    np.testing.assert_array_equal([reference([words(c)], words(k))[0] for c, k, _ in VECTORS], expected)


def test_numbers_are_those_of_the_counter(device):
    """In the order block, index, step, purpose; of seeds all 64 bits count."""
    seed, step, purpose = 0xFEDCBA9876543210, 5, 3
    counters = [(block, index, step, purpose) for index in range(100) for block in range(2)]
    expected = (reference(counters, (seed & 0xFFFFFFFF, seed >> 32)) >> np.uint64(8)) * 2.0**-24
    drawn = numbers(device, seed, step, purpose, n=100)
    np.testing.assert_array_equal(drawn.reshape(-1, 4), expected)
    assert 0 <= drawn.min() and drawn.max() < 1


def test_streams_do_not_collide(device):
    """Of seeds 2^32 apart, steps, purposes and blocks."""
    kinds = [(0, 0, 0), (2**32, 0, 0), (1, 0, 0), (0, 1, 0), (0, 4000, 0), (0, 0, 1)]
    drawn = np.vstack([numbers(device, *kind, n=20_000).reshape(-1, 4) for kind in kinds])
    assert len(np.unique(drawn, axis=0)) == len(drawn) == len(kinds) * 40_000


def test_numbers_are_uniform_and_independent(device):
    """Mean, variance and correlation of neighbours in block, index and step, within 5 standard deviations."""
    n = 200_000
    here, next_step = (numbers(device, 7, step, n=n, blocks=1).reshape(n, 4) for step in (0, 1))
    np.testing.assert_allclose(here.mean(axis=0), 0.5, atol=5 * np.sqrt(1 / 12 / n))
    np.testing.assert_allclose(here.var(axis=0), 1 / 12, atol=5 * np.sqrt(1 / 180 / n))
    pairs = [
        (here[:, 0], here[:, 1]),
        (here[:-1, 0], here[1:, 0]),
        (here[:, 0], next_step[:, 0]),
        (here[:, 2], here[:, 3]),
    ]
    for a, b in pairs:
        assert abs(np.corrcoef(a, b)[0, 1]) < 5 / np.sqrt(n)


@pytest.mark.parametrize("seed", [-1, 2**64, 0.5])
def test_seeds_that_are_none(seed):
    with pytest.raises(wn.InputError, match=f"seed={seed}: expected a whole number of 0 to"):
        wn.Trainer(wn.MLP(2, 3, device="cpu"), sample=sample, seed=seed)


@wp.func
def sample(index: int, random: wn.random.Stream):
    u = wn.random.uniform(random, 0)
    return wp.vec2(u[0], u[1]), wp.vec3(u[2], u[3], 0.0)


@wp.func
def old_sample(index: int, random: wp.uint32):
    u = wp.randf(random)
    return wp.vec2(u, u), wp.vec3(u)


def test_a_sample_with_another_generator():
    with pytest.raises(wn.InputError, match=r"sample=old_sample .*expected .*random: wn\.random\.Stream"):
        wn.Trainer(wn.MLP(2, 3, device="cpu"), sample=old_sample)


def test_trainers_with_seeds_of_64_bits():
    """2^32 was 0."""
    losses = []
    for seed in (0, 2**32, 2**64 - 1):
        trainer = wn.Trainer(wn.MLP(2, 3, device="cpu", seed=0), sample=sample, batch=64, seed=seed)
        trainer.run(1)
        losses.append(trainer.loss)
    assert len(set(losses)) == 3
