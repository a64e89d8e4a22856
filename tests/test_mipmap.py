"""The learned mip maps' parts: sampling, the training gradient, the judge, the classical methods, reproducibility."""

from dataclasses import replace

import numpy as np
import pytest
import reference
import warp as wp

from warp_neural.errors import InputError
from warp_neural.imaging.image import displayed_psnr
from warp_neural.samples.mipmap.classical import box_filter, toksvig
from warp_neural.samples.mipmap.judge import judge, random_directions, render
from warp_neural.samples.mipmap.learn import Learner, Recipe
from warp_neural.samples.mipmap.maps import Maps, MaterialConfig, pack, source_maps
from warp_neural.train.optim import SGD, Adam

SIDE = 32  # of the source; 8 x 8 texels learn
OURS = {"uniform_share": 0.3, "weights": (1.0, 20.0)}


@pytest.fixture(scope="module")
def source():
    """A bumpy, partly metallic square with roughness from 0.25 to 0.5."""
    rng = np.random.default_rng(5)
    normal = reference.normalize(rng.normal(size=(SIDE, SIDE, 3)) * 0.25 + [0, 0, 1])
    normal[..., 2] = np.abs(normal[..., 2])
    maps = Maps(
        rng.uniform(0.1, 0.9, (SIDE, SIDE, 3)),
        normal,
        rng.uniform(0.25, 0.5, (SIDE, SIDE)),
        (rng.random((SIDE, SIDE)) > 0.7) * 1.0,
        np.ones((SIDE, SIDE)),
    )
    return Maps(**{name: image.astype(np.float32) for name, image in maps.arrays().items()})


def test_render_against_float64(device, source):
    """The reference shades all 16 texels and averages; a candidate shades one. Both as in float64, after display."""
    lights, views = random_directions(6, 1), random_directions(6, 2)
    small = box_filter(source, 4)
    truth, picture = render(pack(source, 4, device), [small], lights, views)
    for i, (light, view) in enumerate(zip(lights.astype(np.float64), views.astype(np.float64), strict=True)):
        for shown, maps, factor in ((truth, source, 4), (picture, small, 1)):
            expected = reference.display(reference.render_mean(maps.arrays(), factor, light, view))
            difference = np.abs(shown[i].reshape(-1, 3) - expected)
            # gamma's slope at black makes float32's 1e-7 a visible 1e-3 in the odd texel on the horizon
            assert np.quantile(difference, 0.95) < 1e-4 and difference.max() < 2e-2


@pytest.mark.parametrize("weights", [(1.0, 0.0), (0.0, 1.0)])
def test_training_gradient_against_float64(device, source, weights):
    """The gradient kernel itself, its own lobes in play, against finite differences of the error that `judge` takes.

    Both sides are noisy; what this must catch is an adjoint that is missing or wrong.
    """
    start = toksvig(source, 16)
    packed = pack(source, 16, device)
    learner = Learner(packed, Recipe(SGD, 0.0, start, 0.3, weights), steps=1, pairs=10000, seed=1)
    learner.gradient.launch()
    gradients = {name: learner.parameters[name].grad.numpy().copy() for name in start.arrays()}
    steps = {"roughness": 0.01, "albedo": 0.02, "metalness": 0.02, "specular": 0.02}
    shifted = []
    for name, step in steps.items():
        shifted += [replace(start, **{name: getattr(start, name) + sign * step}) for sign in (1, -1)]
    errors = judge(packed, shifted, pairs=64000, seed=2)  # all at once: most of it is the reference
    chosen = iter(errors.linear if weights[0] else errors.displayed)
    for name, step in steps.items():
        expected = (next(chosen) - next(chosen)) / (2 * step)
        measured = gradients[name].sum() / packed.shape[1]
        assert abs(measured - expected) < 0.1 * abs(expected) + 2e-5, name


def test_importance_sampling_is_unbiased_and_quieter(device, source):
    """Uniform pairs and the recipe's give the same mean gradient; the recipe's vary much less."""
    packed, start = pack(source, 4, device), toksvig(source, 4)
    means, noise = [], []
    for share in (1.0, 0.3):
        learner = Learner(packed, Recipe(SGD, 0.0, start, share, (1.0, 0.0)), steps=1, pairs=500, seed=3)
        runs = []
        for _ in range(16):
            learner.step()
            runs.append(learner.parameters["roughness"].grad.numpy().copy())
        means.append(np.mean(runs, axis=0))
        noise.append(np.std(runs, axis=0, ddof=1) / 4)
    deviation = (means[0] - means[1]) / np.hypot(*noise)
    assert np.median(np.abs(deviation)) < 1.0  # 0.67 for a normal distribution
    assert np.median(noise[1]) < 0.5 * np.median(noise[0])


def test_the_same_seed_gives_the_same_maps(device, source):
    recipe = Recipe(Adam, 0.01, box_filter(source, 4), **OURS)
    results = []
    for seed in (1, 1, 2):
        learner = Learner(pack(source, 4, device), recipe, steps=10, pairs=2, seed=seed)
        for _ in range(10):
            learner.step()
        results.append(learner.parameters.flat.numpy().copy())
    np.testing.assert_array_equal(results[0], results[1])
    assert (results[0] != results[2]).any()


@pytest.mark.cuda
@pytest.mark.skipif(not wp.is_cuda_available(), reason="compares CUDA with the CPU")
def test_cpu_and_cuda_agree(source):
    """Same random integers; sines, roots and powers differ by ulps, which 20 Adam steps of 0.01 may spread.

    Stated tolerance: the mean difference of any map stays below 1e-3, of errors below 1 %.
    """
    results, errors = [], []
    for name in ("cpu", "cuda:0"):
        packed = pack(source, 4, wp.get_device(name))
        learner = Learner(packed, Recipe(Adam, 0.01, toksvig(source, 4), **OURS), steps=20, pairs=4, seed=1)
        for _ in range(20):
            learner.step()
        results.append(learner.maps())
        errors.append(judge(packed, [toksvig(source, 4)], pairs=256, seed=2))
    for name, image in results[0].arrays().items():
        assert np.abs(image - getattr(results[1], name)).mean() < 1e-3, name
    np.testing.assert_allclose(errors[0].linear, errors[1].linear, rtol=1e-2)
    np.testing.assert_allclose(errors[0].displayed, errors[1].displayed, rtol=1e-2)


def test_judge_finds_perfect_maps_perfect(device, source):
    """A source whose texels are all alike under each learned texel is exactly its box-filtered self."""
    flat = box_filter(source, 4)
    alike = Maps(**{name: image.repeat(4, axis=0).repeat(4, axis=1) for name, image in flat.arrays().items()})
    errors = judge(pack(alike, 4, device), [flat, replace(flat, roughness=flat.roughness * 0.8)], pairs=64, seed=1)
    assert errors.linear[0] < 1e-8 < errors.linear[1]
    assert errors.displayed[0] < 1e-8 < errors.displayed[1]
    assert errors.linear_spread[1] > 0


def test_toksvig_widens_by_the_normals_length(source):
    """Equation 1 at one texel by hand, and no change where normals agree."""
    tilted = reference.normalize(np.array([[0.3, 0, 1], [-0.3, 0, 1], [0, 0.3, 1], [0, -0.3, 1]]))
    normal = tilted.reshape(2, 2, 3).astype(np.float32)
    one = np.ones((2, 2), np.float32)
    maps = Maps(np.ones((2, 2, 3), np.float32), normal, 0.3 * one, 0 * one, one)
    length = 1 / np.sqrt(1.09)
    power = 2 / 0.3**4 - 2
    power *= length / (length + power * (1 - length))
    np.testing.assert_allclose(toksvig(maps, 2).roughness, (2 / (power + 2)) ** 0.25, rtol=1e-4)
    np.testing.assert_allclose(toksvig(maps, 2).normal, [[[0, 0, 1]]], atol=1e-6)
    flat = replace(maps, normal=np.broadcast_to(np.float32([0, 0, 1]), (2, 2, 3)))
    np.testing.assert_allclose(toksvig(flat, 2).roughness, 0.3, rtol=1e-4)


def test_pack_puts_a_texels_source_in_one_row(source):
    planes = pack(source, 4, wp.get_device("cpu")).numpy()
    assert planes.shape == (16, 64, 8)
    i, j, y, x = 3, 5, 2, 1
    at = 4 * i + y, 4 * j + x
    expected = [*source.albedo[at], source.roughness[at], *source.normal[at][:2], source.metalness[at], 1]
    np.testing.assert_array_equal(planes[4 * y + x, 8 * i + j], expected)


def test_psnr():
    picture = np.zeros((1, 4, 4, 3))
    assert displayed_psnr(picture, picture + 0.1) == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"crop": 30}, "--factor 4: does not divide 30 x 30.*--crop 28"),
        ({"factor": 1}, "--factor 1"),
        ({"roughness_scale": 0.0}, "--roughness-scale 0.0"),
        ({"roughness_scale": 1.5}, "--roughness-scale 1.5"),
        ({"crop": 5000}, "5000"),
    ],
)
def test_bad_options(options, message):
    with pytest.raises(InputError, match=message):
        source_maps(MaterialConfig(**options), wp.get_device("cpu"))
