"""Filters of neural textures: the mean of single texels is the filtered value; the exact one and its gradients."""

from functools import cache

import numpy as np
import pytest
import reference_filtering
import reference_texture
import warp as wp
from texture_maps import results_of

import warp_neural as wn
from warp_neural.errors import InputError
from warp_neural.kernels.texture.filters import ellipse
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.texture.kinds import to_maps
from warp_neural.texture.state import Map, Tensor, TextureState
from warp_neural.texture.texture import Texture

filters = wn.texture.filters
FILTERS = {"nearest": filters.nearest, "bilinear": filters.bilinear, "bicubic": filters.bicubic}
FILTERS["gaussian"] = filters.gaussian(0.7)
SPEC = TextureSpec(12, 16, 3, 3, (Grid(2, 4, "bilinear"), Grid(4, 3, "bilinear")), (24,))
POINTS, DRAWS = 256, 4096


def random_state(spec, seed=0):
    """Neighbouring texels differ by a third of the range and more."""
    rng = np.random.default_rng(seed)
    cells = [[(*spec.cells(m, g), grid.channels) for g, grid in enumerate(spec.grids)] for m in range(spec.mips)]
    latents = tuple(tuple(rng.integers(-6, 7, shape).astype(np.int8) for shape in level) for level in cells)
    tensors = {
        name: Tensor(rng.integers(-9, 10, shape).astype(np.int32), 2.0**-5) for name, shape in spec.tensors.items()
    }
    last = len(spec.hidden)
    tensors[f"biases_{last}"] = Tensor(np.full(spec.channels, 32, np.int32), 2.0**-6)  # values around the middle
    maps = tuple(Map(f"map {c}", "linear", (0.0,), (1.0,)) for c in range(spec.channels))
    return TextureState(spec, latents, tensors, maps)


@cache
def levels_of(texture):
    """What the device has as texels, [height, width, channels] of each level, float64."""
    maps = [to_maps(results_of(texture.decoder, mip), texture.state.maps).values() for mip in range(SPEC.mips)]
    return [np.concatenate(list(level), -1).astype(np.float64) for level in maps]


def places():
    """uv, some far outside of [0, 1], and footprints: none, round, up to 40 times as long as wide, of all levels."""
    rng = np.random.default_rng(1)
    uv = rng.uniform(-2, 3, (POINTS, 2))
    turn = rng.uniform(0, 2 * np.pi, (2, POINTS))
    rotations = np.moveaxis(np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]), (2, 3), (0, 1))
    scales = 2.0 ** rng.uniform([-1, -1], [2.5, 5], (POINTS, 2)) / 16
    scales[::4] = 0
    scales[1::4, 1] = scales[1::4, 0]
    footprints = np.einsum("pab,pb,pbc->pac", rotations[0], scales, rotations[1])
    return uv.astype(np.float32), footprints.astype(np.float32)


@pytest.fixture(scope="module")
def texture(device):
    return Texture(random_state(SPEC), device)


def test_texels(texture):
    """The network rounds its inputs and what is between layers to float16."""
    state = texture.state
    tensors = {name: tensor.integers * np.float64(tensor.step) for name, tensor in state.tensors.items()}
    for mip, level in enumerate(levels_of(texture)):
        expected = reference_texture.decode(SPEC, state.latents[mip], tensors, mip)
        np.testing.assert_allclose(level, np.clip(expected, 0, 1), atol=2e-3)


def draw(texture, filter, uv, footprints):
    """[points, draws, channels]."""
    read, Params, vec = texture.make_sampler(filter), texture.Params, wp.types.vector(SPEC.channels, float)

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(params: Params, uv: wp.array[wp.vec2], footprint: wp.array[wp.mat22], y: wp.array2d[vec]):
        p, n = wp.tid()
        random = wn.random.stream(wp.uint64(7), n, p)
        y[p, n] = read(params, uv[p], footprint[p], wn.random.uniform(random, 0))

    device = texture.device
    y = wp.empty((POINTS, DRAWS), dtype=vec, device=device)
    inputs = [wp.array(uv, dtype=wp.vec2, device=device), wp.array(footprints, dtype=wp.mat22, device=device)]
    wp.launch(kernel, y.shape, [texture.params, *inputs], [y], device=device)
    return y.numpy().astype(np.float64)


def filtered(texture, name, uv, footprints):
    """[points, channels]."""
    found = []
    for at, footprint in zip(np.float64(uv), np.float64(footprints), strict=True):
        lod, line = reference_filtering.ellipse(footprint, SPEC.size(0))
        found.append(reference_filtering.filtered(levels_of(texture), name, at, lod, line, 1000 if line.any() else 1))
    return np.array(found)


@pytest.mark.parametrize("name", FILTERS)
def test_means_of_draws_are_filtered_values(texture, name):
    """Squared errors of means of n draws fall as 1 / n, over four decades; and what is left is not a bias."""
    uv, footprints = places()
    y, expected = draw(texture, FILTERS[name], uv, footprints), filtered(texture, name, uv, footprints)
    counts = 4 ** np.arange(7)
    errors = [(y.reshape(POINTS, -1, n, SPEC.channels).mean(2) - expected[:, None]) for n in counts]
    squares = np.array([np.square(error).mean() for error in errors])
    slope = np.polyfit(np.log(counts), 0.5 * np.log(squares), 1)[0]
    assert squares[0] > 0.1**2  # there is something to average
    assert slope == pytest.approx(-0.5, abs=0.03)  # the last error is known to 6 %, six octaves of n away
    bias = squares[-1] - y.var(axis=1, ddof=1).mean() / DRAWS
    assert bias < (0.5 / 255) ** 2


@pytest.mark.parametrize("name", FILTERS)
def test_every_texel_has_its_weight(device, name):
    """One direction, by numbers in equal steps instead of random ones."""
    filter, steps = FILTERS[name], 2**16

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(x: wp.array[float], texels: wp.array2d[int]):
        p, n = wp.tid()
        texels[p, n] = filter(x[p], (float(n) + 0.5) / float(steps))

    x = np.float32([-7.3, -0.5, 0.0, 0.25, 0.5, 3.999, 100.75])
    texels = wp.empty((len(x), steps), dtype=int, device=device)
    wp.launch(kernel, texels.shape, [wp.array(x, device=device)], [texels], device=device)
    i = np.floor(x)[:, None] + np.arange(-5, 6)
    found = (texels.numpy()[:, None] == i[..., None]).mean(-1)
    np.testing.assert_allclose(found, reference_filtering.WEIGHTS[name](np.float64(x)[:, None], i), atol=2 / steps)


def test_ends_of_random_numbers_are_read(texture):
    """0 and 1 - 2^-24, where a Gaussian is widest and the next level nearest."""
    read, Params, vec = texture.make_sampler(FILTERS["gaussian"]), texture.Params, wp.types.vector(3, float)

    @wp.kernel(module="unique", enable_backward=False)
    def kernel(params: Params, y: wp.array[vec]):
        i = wp.tid()
        u = wp.where(i % 2 == 0, 0.0, wp.static(1.0 - 2.0**-24))
        size = wp.pow(2.0, float(i / 2) - 3.0)
        y[i] = read(params, wp.vec2(0.3, 0.7), wp.mat22(size, 0.0, 0.0, size), wp.vec4(u, u, u, u))

    y = wp.empty(16, dtype=vec, device=texture.device)
    wp.launch(kernel, 16, [texture.params], [y], device=texture.device)
    texels = np.concatenate([level.reshape(-1, 3) for level in levels_of(texture)])
    assert np.abs(y.numpy()[:, None] - texels).max(-1).min(1).max() < 1e-3


def test_places_that_are_none_read_some_texel(texture):
    uv, footprints = places()
    for n, bad in enumerate((np.nan, np.inf, -np.inf, 1e38)):
        uv[4 * n], footprints[4 * n + 1, 0, 0], footprints[4 * n + 2] = bad, bad, bad
    y = draw(texture, FILTERS["bicubic"], uv, footprints)
    assert (y >= 0).all() and (y <= 1).all()


def test_ellipses(device):
    @wp.kernel(module="unique", enable_backward=False)
    def kernel(footprint: wp.array[wp.mat22], lod: wp.array[float], line: wp.array[wp.vec2]):
        p = wp.tid()
        level, along = ellipse(footprint[p], wp.vec2i(12, 16))
        lod[p] = level
        line[p] = along

    _, footprints = places()
    lod, line = (wp.empty(POINTS, dtype=dtype, device=device) for dtype in (float, wp.vec2))
    wp.launch(kernel, POINTS, [wp.array(footprints, dtype=wp.mat22, device=device)], [lod, line], device=device)
    expected = [reference_filtering.ellipse(np.float64(footprint), (12, 16)) for footprint in footprints]
    np.testing.assert_allclose(lod.numpy(), [each for each, _ in expected], atol=1e-5)
    ours, theirs = line.numpy(), np.array([each for _, each in expected])
    ours *= np.sign((ours * theirs).sum(-1, keepdims=True))  # both directions are the same line
    long = np.linalg.norm(theirs, axis=-1) > 0.01  # of shorter ones rounding turns the direction
    assert long.sum() > POINTS / 3
    np.testing.assert_allclose(ours[long], theirs[long], atol=2e-3)


def test_exact_filtering_and_its_gradients(texture):
    """Against float64 sums and their central differences; a level outside of the chain has no slope."""
    sample, Params, vec = texture.sample, texture.Params, wp.types.vector(SPEC.channels, float)

    @wp.kernel(module="unique")
    def kernel(params: Params, uv: wp.array[wp.vec2], lod: wp.array[float], y: wp.array[vec]):
        i = wp.tid()
        y[i] = sample(params, uv[i], lod[i])

    rng, count, device = np.random.default_rng(2), 64, texture.device
    uv, lod = (rng.uniform(*ends).astype(np.float32) for ends in ((-1, 2, (count, 2)), (-1, 3, count)))
    adjoint = rng.normal(size=(count, SPEC.channels)).astype(np.float32)
    inputs = [wp.array(uv, dtype=wp.vec2, device=device, requires_grad=True)]
    inputs.append(wp.array(lod, device=device, requires_grad=True))
    y = wp.zeros(count, dtype=vec, device=device, requires_grad=True)
    with wp.Tape() as tape:
        wp.launch(kernel, count, [texture.params, *inputs], [y], device=device)
    tape.backward(grads={y: wp.array(adjoint, dtype=vec, device=device)})

    def truth(*step):
        at = zip(np.float64(uv) + step[:2], np.float64(lod) + step[2], strict=True)
        return np.array([reference_filtering.filtered(levels_of(texture), "bilinear", *each) for each in at])

    rounding = 100 if device.is_cuda else 1  # of a network's results, when lanes of a warp are missing
    np.testing.assert_allclose(y.numpy(), truth(0, 0, 0), atol=1e-5 * rounding)
    gradients = [*inputs[0].grad.numpy().T, inputs[1].grad.numpy()]
    for found, step in zip(gradients, 1e-6 * np.eye(3), strict=True):
        expected = ((truth(*step) - truth(*-step)) / 2e-6 * adjoint).sum(-1)
        np.testing.assert_allclose(found, expected, atol=2e-4 * rounding * np.abs(expected).max())


@pytest.mark.parametrize("filter", ["bicubic", filters.gaussian])
def test_what_is_no_filter_is_refused(filter):
    with pytest.raises(InputError, match=r"^filter=.*: expected nearest, bilinear, bicubic, gaussian\(sigma\)"):
        Texture(random_state(SPEC), "cpu").make_sampler(filter)


@pytest.mark.parametrize("sigma", [0, -1.0, float("nan"), "wide"])
def test_bad_deviations_are_refused(sigma):
    with pytest.raises(InputError, match=r"^sigma=.*: expected a positive number of texels"):
        filters.gaussian(sigma)
