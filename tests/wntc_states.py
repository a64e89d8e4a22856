"""States of neural textures for tests of their files: latents as training leaves them, correlated and mostly zero."""

import numpy as np

from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.texture.state import Map, Tensor, TextureState

E24 = Grid(4, 24, "learned"), Grid(8, 16, "separable"), Grid(16, 8, "bilinear")
SMALL = Grid(2, 3, "learned"), Grid(8, 5, "separable"), Grid(16, 4, "bilinear")


def latents(shape, grid, rng, zeros=0.5):
    """Laplace; scales differ by channel (0.1 to 4) and by place; neighbours share signs; one channel is zero."""
    rows, columns, channels = shape
    activity = np.exp(rng.normal(size=(-(-rows // 4), -(-columns // 4), 1))).repeat(4, 0).repeat(4, 1)[:rows, :columns]
    values = rng.laplace(size=shape) * activity * np.geomspace(0.1, 4, channels) * zeros
    values[:, 1:] += 0.4 * values[:, :-1]
    if channels > 2:
        values[..., 1] = 0
    whole = np.clip(np.round(values), -grid.limit, grid.limit)
    return (np.where(whole < 0, -1, 1) if grid.bits == 1 else whole).astype(np.int8)


def make_state(spec, seed=0, zeros=0.5, extra=None):
    rng = np.random.default_rng(seed)
    each = tuple(
        tuple(latents((*spec.cells(mip, g), grid.channels), grid, rng, zeros) for g, grid in enumerate(spec.grids))
        for mip in range(spec.mips)
    )
    tensors = {}
    for name, shape in spec.tensors.items():
        integers = np.round(rng.normal(size=shape) * rng.choice([0, 4, 16, 64])).astype(np.int32)
        tensors[name] = Tensor(integers, float(np.float16(rng.uniform(0.001, 0.1))))
    maps = [Map(f"map {c}", "linear", (0.0,), (1.0,), f"{c}.png") for c in range(spec.channels)]
    maps += [Map("flat", "srgb", (0.25, 0.5, 0.1), (0.25, 0.5, 0.1), bits=16)]
    return TextureState(spec, each, tensors, tuple(maps), extra or {})


def assert_same(a, b):
    assert a.spec == b.spec and a.maps == b.maps and dict(a.extra) == dict(b.extra)
    for mip, (ours, theirs) in enumerate(zip(a.latents, b.latents, strict=True)):
        for g, (x, y) in enumerate(zip(ours, theirs, strict=True)):
            assert y.dtype == np.int8 and (x == y).all(), (mip, g)
    for name, tensor in a.tensors.items():
        assert b.tensors[name].step == tensor.step and (b.tensors[name].integers == tensor.integers).all(), name


def golden_spec():
    return TextureSpec(48, 64, 5, 3, SMALL, (8,))
