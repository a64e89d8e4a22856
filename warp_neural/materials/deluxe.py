"""The layered material with everything: glazed bricks with rings of brushed brass, dust and fingerprints."""

import numpy as np
from scipy.ndimage import gaussian_filter

from warp_neural.materials.default_material import default_material
from warp_neural.materials.layered import LayeredMaterial

_BRASS = np.array([0.89, 0.66, 0.31])
_PRINTS = 9
_SEED = 7


def deluxe_material(size: int = 512) -> LayeredMaterial:
    """The default material under a glaze with orange peel, of twelve maps, `size` x `size` texels; 4 to 4096.

    Bricks are coated, joints and pits are not. Four rings of brass, brushed along their way round, are let in. Dust
    lies in what is low, fingerprints on the glaze and the brass. All but the bricks is periodic. Deterministic.
    """
    bricks = default_material(size)
    rng = np.random.default_rng(_SEED)
    x, y = _places(size)
    ring, angle = _rings(x, y)
    glaze = _smoothstep(0.62, 0.45, gaussian_filter(bricks.roughness, 0.7)) * (1 - ring)
    cloud = _noise(rng, size, 0.06)
    fine = _noise(rng, size, 0.004)
    tint = np.stack([1 - 0.05 * cloud, 1 - 0.2 * cloud, 1 - 0.45 * cloud], axis=-1)
    flat = np.array([0.0, 0.0, 1.0])
    maps = {
        "color": _mix(bricks.albedo, _BRASS * (0.9 + 0.1 * fine)[..., None], ring),
        "normal": _unit(_mix(bricks.normal, flat, ring)),
        "roughness": _mix(bricks.roughness, 0.28 + 0.1 * fine, ring),
        "metalness": ring,
        "anisotropy": 0.85 * ring,
        "tangent": np.stack([np.cos(2 * angle), np.sin(2 * angle)], axis=-1),
        "coat": glaze,
        "coat_normal": _normal(_noise(rng, size, 0.012) * 0.01 + 0.001 * np.sin(2 * np.pi * (5 * x + 3 * y)), size),
        "coat_roughness": 0.06 + 0.16 * cloud * fine,
        "coat_color": tint,
        "fingerprints": _fingerprints(rng, x, y),
        "dust": 0.55 * _smoothstep(0.5, 0.9, _noise(rng, size, 0.03)) + 0.4 * (1 - glaze) * (1 - ring) * cloud,
    }
    maps = {name: np.clip(value, -1, 1).astype(np.float32) for name, value in maps.items()}
    return LayeredMaterial("deluxe", {**maps, "diffuse_roughness": 0.4})


def _places(size: int) -> tuple[np.ndarray, np.ndarray]:
    """u and v of the texels' centres; v goes up."""
    at = (np.arange(size) + 0.5) / size
    return np.meshgrid(at, at[::-1])


def _rings(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Share of brass, and the angle across the brush's strokes, of two by two rings."""
    u, v = (2 * x) % 1 - 0.5, (2 * y) % 1 - 0.5
    radius = np.hypot(u, v)
    return _smoothstep(0.05, 0.043, np.abs(radius - 0.33)), np.arctan2(v, u)


def _fingerprints(rng: np.random.Generator, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Ridges around whorls, worn at their edges."""
    total, size = np.zeros_like(x), len(x)
    reach = np.arange(-int(0.08 * size) - 1, int(0.08 * size) + 2)
    for _ in range(_PRINTS):
        (cx, cy), turn, phase = rng.random(2), rng.uniform(0, np.pi), rng.uniform(0, 2 * np.pi)
        at = np.ix_((int((1 - cy) * size) + reach) % size, (int(cx * size) + reach) % size)
        dx, dy = (x[at] - cx + 0.5) % 1 - 0.5, (y[at] - cy + 0.5) % 1 - 0.5
        across, along = dx * np.cos(turn) + dy * np.sin(turn), dy * np.cos(turn) - dx * np.sin(turn)
        distance = np.hypot(across / 0.05, along / 0.075)
        bend = 0.25 * np.sin(3 * np.arctan2(along, across) + phase)
        ridges = 0.5 + 0.5 * np.cos(2 * np.pi * (7 * np.hypot(across / 0.05, along / 0.065) + bend))
        total[at] = np.maximum(total[at], _smoothstep(1.0, 0.7, distance) * (0.25 + 0.75 * ridges))
    return total


def _noise(rng: np.random.Generator, size: int, scale: float) -> np.ndarray:
    """Periodic, in [0, 1], as coarse as `scale` of the side; the same at every size of 256 and more."""
    cells = rng.random((256, 256))
    smooth = gaussian_filter(cells, scale * 256, mode="wrap")
    smooth = (smooth - smooth.min()) / np.ptp(smooth)
    at = ((np.arange(size) + 0.5) / size * 256 - 0.5) % 256
    low, share = at.astype(int), at % 1
    rows = smooth[low] * (1 - share)[:, None] + smooth[(low + 1) % 256] * share[:, None]
    return rows[:, low] * (1 - share) + rows[:, (low + 1) % 256] * share


def _normal(height: np.ndarray, size: int) -> np.ndarray:
    """Of a periodic height in sides of the square `[size, size]`."""
    right = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) * (size / 2)
    up = (np.roll(height, 1, 0) - np.roll(height, -1, 0)) * (size / 2)
    return _unit(np.stack([-right, -up, np.ones_like(height)], axis=-1))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _mix(a: np.ndarray, b: np.ndarray, share: np.ndarray) -> np.ndarray:
    share = share.reshape(share.shape + (1,) * (a.ndim - 2))
    return a + (b - a) * share


def _smoothstep(first: float, last: float, x: np.ndarray) -> np.ndarray:
    """0 at `first`, 1 at `last`, which may be the smaller."""
    t = np.clip((x - first) / (last - first), 0, 1)
    return t * t * (3 - 2 * t)
