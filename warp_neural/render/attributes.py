"""What a mesh lacks and rays want: normals and tangents of vertices, details of triangles. Float64 inside."""

import numpy as np
from scipy.sparse import csr_array

CREASE = np.cos(np.radians(40))  # of the angle between two triangles that are shaded as one surface
MOST_PAIRS = 10**8  # of triangles that meet


def unit(vectors: np.ndarray) -> np.ndarray:
    """[..., 3], those without a length stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1)


def face_normals(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Of twice the triangle's area. [m, 3]"""
    a, b, c = np.moveaxis(positions[triangles], 1, 0)
    return np.cross(b - a, c - a)


def smooth_normals(positions: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which vertices to take, [n'], their unit normals, [n', 3], and triangles of them: vertices where triangles meet
    at a crease are split. A normal is that of the triangles around, each by its angle there (Thürmer and Wüthrich
    1998), of all vertices at one place, so that seams of textures are not seen.
    """
    _, place = np.unique(positions, axis=0, return_inverse=True)
    place, faces = place.reshape(-1)[triangles].reshape(-1), unit(face_normals(positions, triangles))
    faces, angles = np.repeat(faces, 3, axis=0), corner_angles(positions, triangles).reshape(-1)
    corners = np.arange(len(place))
    meets = csr_array((np.ones(len(place)), (corners, place)), shape=(len(place), place.max() + 1))
    if (meets.sum(axis=0) ** 2).sum() > MOST_PAIRS:  # all of them are smooth then
        normals = (meets @ (meets.T @ (faces * angles[:, None]))).reshape(-1, 3)
    else:
        i, j = (meets @ meets.T).nonzero()
        near = (faces[i] * faces[j]).sum(axis=-1) >= CREASE
        shared = csr_array((angles[j[near]], (i[near], j[near])), shape=(len(place), len(place)))
        normals = shared @ faces
    normals = unit(normals)
    normals[~normals.any(axis=-1)] = 0, 1, 0
    keys = np.column_stack([triangles.reshape(-1), np.rint(normals * 1e6)])
    _, first, new = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return triangles.reshape(-1)[first], normals[first], new.reshape(-1, 3)


def corner_angles(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Inside, in radians. [m, 3]"""
    points = positions[triangles]
    b, c = (unit(np.roll(points, -k, axis=1) - points) for k in (1, 2))
    return np.arccos(np.clip((b * c).sum(axis=-1), -1, 1))


def uv_determinants(uvs: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Twice the area of triangles in uv, negative where the texture is mirrored. [m]"""
    a, b, c = np.moveaxis(uvs[triangles], 1, 0)
    e, f = b - a, c - a
    return e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]


def tangents_of(positions: np.ndarray, normals: np.ndarray, uvs: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Along dP/du, orthogonal to the normal, and the sign s with s (n x t) along dP/dv. [n, 4]

    Vertices whose triangles have both signs are to be split before, see `split_mirrored`.
    """
    a, b, c = np.moveaxis(positions[triangles], 1, 0)
    ua, ub, uc = np.moveaxis(uvs[triangles], 1, 0)
    determinant = uv_determinants(uvs, triangles)
    mirrored = np.sign(determinant)[:, None]
    along = mirrored * ((b - a) * (uc - ua)[:, 1:] - (c - a) * (ub - ua)[:, 1:])  # times |determinant|: by its area
    sums, signs = np.zeros_like(positions), np.zeros(len(positions))
    for corner in range(3):
        np.add.at(sums, triangles[:, corner], along)
        np.add.at(signs, triangles[:, corner], determinant)
    tangents = unit(sums - normals * (sums * normals).sum(axis=-1, keepdims=True))
    lost = np.linalg.norm(tangents, axis=-1) < 0.5
    helper = np.where(np.abs(normals[:, :1]) > 0.5, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    tangents[lost] = unit(np.cross(helper, normals))[lost]
    return np.column_stack([tangents, np.where(signs < 0, -1.0, 1.0)])


def split_mirrored(uvs: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which vertices to take, [n'], and triangles of them, so that none is shared by texture and mirrored texture."""
    n = len(uvs)
    keys = triangles + n * (uv_determinants(uvs, triangles) < 0)[:, None]
    taken, new = np.unique(keys, return_inverse=True)
    return taken % n, new.reshape(-1, 3)


def details(positions: np.ndarray, normals: np.ndarray, uvs: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """`Geometry.detail`: log2 of lengths in uv over those in space, and the mean curvature along the sides. [m, 2]"""
    area = np.linalg.norm(face_normals(positions, triangles), axis=-1)
    ratio = np.abs(uv_determinants(uvs, triangles)) / np.maximum(area, 1e-30)
    p, n = positions[triangles], normals[triangles]
    side, turn = p - np.roll(p, 1, axis=1), n - np.roll(n, 1, axis=1)
    curvature = (side * turn).sum(axis=-1) / np.maximum((side * side).sum(axis=-1), 1e-30)  # of each side
    return np.column_stack([0.5 * np.log2(np.maximum(ratio, 1e-30)), curvature.mean(axis=-1)])
