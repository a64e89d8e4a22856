"""Built-in meshes: a sphere, a floor, and a knob that shows a material from all sides. They stand on y = 0."""

import numpy as np
from scipy.interpolate import BSpline

from warp_neural.kernels.errors import require_whole
from warp_neural.render.mesh import Mesh

COLUMNS = 256  # around: of a silhouette 1000 pixels wide, sides are within 0.1 pixel of the circle
RINGS = 400  # of the knob, from top to bottom
FINE = 20  # points a ring, between which the knob's rings are spread
BALL = 1.5, 1.0  # the knob's: height of its middle, radius
GROOVE = 102, 113  # degrees from the top
DEPTH = 0.1  # of the groove
FOOT = ((0.36, 0.57), (0.31, 0.49), (0.31, 0.40), (0.38, 0.32), (0.62, 0.28), (0.86, 0.27), (0.96, 0.25))
RIM = ((1.0, 0.21), (1.0, 0.12), (1.0, 0.05), (0.97, 0.0), (0.9, 0.0), (0.6, 0.0), (0.3, 0.0))


def sphere(radius: float = 1.0, *, material: int = 0, columns: int = COLUMNS, repeat: float = 2.0) -> Mesh:
    """It stands on the floor. u goes `repeat` times around, to the right as seen from outside, v half as often up."""
    require_whole("columns", columns, 4, 4096)
    fall = np.linspace(0, np.pi, columns // 2 + 1)
    sine, cosine = np.sin(fall), np.cos(fall)
    sine[-1] = 0
    profile = radius * np.column_stack([sine, 1 + cosine])
    return revolved(
        profile, np.column_stack([sine, cosine]), 0.5 * repeat * (1 - fall / np.pi), columns, repeat, material
    )


def floor(size: float = 20.0, *, material: int = 0, repeat: float = 10.0) -> Mesh:
    """A square with sides of `size`, about the origin; the texture repeats `repeat` times, u along +x, v along -z."""
    x, z = np.array([[-0.5, -0.5], [-0.5, 0.5], [0.5, 0.5], [0.5, -0.5]]).T
    return Mesh(
        positions=size * np.column_stack([x, 0 * x, z]),
        triangles=np.array([[0, 1, 2], [0, 2, 3]]),
        normals=np.tile([0.0, 1.0, 0.0], (4, 1)),
        uvs=repeat * np.column_stack([x + 0.5, 0.5 - z]),
        materials=material,
    )


def knob(*, material: int = 0, columns: int = COLUMNS, repeat: float = 3.0) -> Mesh:
    """A ball with a groove on a foot, 2.5 high and 2 wide: bulges and hollows, gentle and tight. One smooth surface.

    u goes `repeat` times around, to the right as seen from outside; v up with the same length at the equator.
    """
    require_whole("columns", columns, 4, 4096)
    points, slopes = along(knob_outline())
    length = np.append(0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    bend = np.linalg.norm(np.diff(slopes / np.linalg.norm(slopes, axis=1, keepdims=True), axis=0), axis=1)
    share = length / length[-1] + np.append(0, np.cumsum(bend)) / bend.sum()  # rings where it is long, or bends
    chosen = np.unique(np.searchsorted(share, np.linspace(0, share[-1], RINGS)).clip(0, len(points) - 1))
    chosen[-1] = len(points) - 1
    slopes = slopes[chosen] / np.linalg.norm(slopes[chosen], axis=1, keepdims=True)
    normals = np.column_stack([-slopes[:, 1], slopes[:, 0]])
    return revolved(points[chosen], normals, -repeat / (2 * np.pi) * length[chosen], columns, repeat, material)


def knob_outline() -> np.ndarray:
    """Control points (radius, height) from the top to the middle of the foot."""
    height, radius = BALL
    ball = []
    for degrees in (*range(0, 91, 15), GROOVE[0] - 3, GROOVE[0] - 1):
        ball.append((degrees, radius))
    ball += [(GROOVE[0], radius), (GROOVE[0] + 1, radius - DEPTH), (GROOVE[0] + 3, radius - DEPTH)]
    ball += [(GROOVE[1] - 3, radius - DEPTH), (GROOVE[1] - 1, radius - DEPTH), (GROOVE[1], radius)]
    ball += [(GROOVE[1] + 1, radius), (GROOVE[1] + 4, radius), (127, radius), (138, radius), (149, radius)]
    angles, radii = np.radians([a for a, _ in ball]), np.array([r for _, r in ball])
    outline = np.column_stack([radii * np.sin(angles), height + radii * np.cos(angles)])
    return np.vstack([outline, FOOT, RIM, [(0.0, 0.0)]])


def along(outline: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and slopes of a uniform cubic B-spline, mirrored at the axis, where it begins and ends. [k, 2] each"""
    mirror = np.array([-1, 1])
    control = np.vstack([outline[1] * mirror, outline, outline[-2] * mirror])
    spline = BSpline(np.arange(len(control) + 4), control, 3)
    place = np.linspace(3, len(control), FINE * len(control) + 1)
    points, slopes = spline(place), spline(place, 1)
    points[[0, -1], 0] = 0
    slopes[[0, -1], 1] = 0
    return points, slopes


def revolved(
    profile: np.ndarray, normals: np.ndarray, v: np.ndarray, columns: int, repeat: float, material: int
) -> Mesh:
    """Turned about the y axis, from its first point on the axis to its last. profile, normals: [rings, 2] of radius
    and height. v: [rings]."""
    rings, turn = len(profile), 2 * np.pi * np.arange(columns + 1) / columns
    sine, cosine = -np.sin(turn), -np.cos(turn)  # the seam of the texture is behind, towards -z
    sine[-1], cosine[-1] = sine[0], cosine[0]

    def around(pairs: np.ndarray) -> np.ndarray:
        r, y = pairs[:, :1], np.broadcast_to(pairs[:, 1:], (rings, columns + 1))
        return np.stack([r * sine, y, r * cosine], axis=-1).reshape(-1, 3)

    u, v = np.broadcast_arrays(repeat * np.arange(columns + 1) / columns, v[:, None])
    flat = np.stack([cosine, 0 * cosine, -sine, np.ones(columns + 1)], axis=-1)
    first = (np.arange(rings - 1)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1)
    below = first + columns + 1
    upper, lower = np.column_stack([first, below, first + 1]), np.column_stack([first + 1, below, below + 1])
    return Mesh(
        positions=around(profile),
        triangles=np.vstack([upper[columns:], lower[:-columns]]),  # without those of no area on the axis
        normals=around(normals),
        uvs=np.column_stack([u.reshape(-1), v.reshape(-1)]),
        tangents=np.tile(flat, (rings, 1)),
        materials=material,
    )
