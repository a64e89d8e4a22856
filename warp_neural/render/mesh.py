"""`Mesh`: triangles with what shading wants of them, on the host."""

from dataclasses import dataclass, replace

import numpy as np

from warp_neural.errors import InputError
from warp_neural.kernels.errors import require_whole
from warp_neural.render.attributes import smooth_normals, split_mirrored, tangents_of, unit

MOST = 2**31 // 3 - 1  # triangles and vertices


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices `positions` [n, 3], `triangles` [m, 3], counter-clockwise as seen from outside. y is up.

    normals [n, 3] (made if None, smooth but for creases above 40 degrees), uvs [n, 2] (zeros if None; v up the
    picture), tangents [n, 4]: along u, and the sign s with s (normal x tangent) along v (made if None, and with
    normals). materials: of all triangles, or [m].
    """

    positions: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray | None = None
    uvs: np.ndarray | None = None
    tangents: np.ndarray | None = None
    materials: int | np.ndarray = 0

    def __post_init__(self) -> None:
        positions = _floats("positions", self.positions, (3,), None)
        n = len(positions)
        triangles = _triangles(self.triangles, n)
        uvs = np.zeros((n, 2)) if self.uvs is None else _floats("uvs", self.uvs, (2,), n)
        if self.normals is None:
            taken, normals, triangles = smooth_normals(positions, triangles)
            positions, uvs = positions[taken], uvs[taken]
        else:
            normals = _directed(unit(_floats("normals", self.normals, (3,), n)))
        arrays = {"positions": positions, "normals": normals, "uvs": uvs}
        if self.tangents is None or self.normals is None:
            taken, triangles = split_mirrored(uvs, triangles)
            arrays = {name: array[taken] for name, array in arrays.items()}
            arrays["tangents"] = tangents_of(**arrays, triangles=triangles)
        else:
            arrays["tangents"] = _floats("tangents", self.tangents, (4,), n)
        arrays |= {"triangles": triangles, "materials": _materials(self.materials, len(triangles))}
        for name, array in arrays.items():
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        return f"Mesh({len(self.triangles)} triangles, materials {', '.join(map(str, np.unique(self.materials)))})"

    def transformed(self, matrix: np.ndarray) -> "Mesh":
        """By an affine [4, 4] or linear [3, 3] matrix that can be inverted; column vectors."""
        matrix = np.asarray(matrix, np.float64)
        if matrix.shape not in ((3, 3), (4, 4)) or not np.isfinite(matrix).all():
            raise InputError(f"matrix of shape {matrix.shape}: expected [4, 4] or [3, 3], finite")
        linear = matrix[:3, :3]
        determinant = np.linalg.det(linear)
        if determinant == 0:
            raise InputError("matrix: flattens the mesh; give one that can be inverted")
        move = matrix[:3, 3] if matrix.shape == (4, 4) else 0
        sign = np.sign(determinant)
        tangents = np.column_stack([unit(self.tangents[:, :3] @ linear.T), sign * self.tangents[:, 3]])
        return replace(
            self,
            positions=self.positions @ linear.T + move,
            normals=unit(self.normals @ np.linalg.inv(linear)),
            tangents=tangents,
            triangles=self.triangles if sign > 0 else self.triangles[:, ::-1],
        )

    def moved(self, offset: tuple[float, float, float] = (0, 0, 0), *, scale: float = 1, turn: float = 0) -> "Mesh":
        """Scaled, turned about +y by `turn` degrees counter-clockwise from above, then moved."""
        cosine, sine = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        matrix = np.eye(4)
        matrix[:3, :3] = scale * np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
        matrix[:3, 3] = offset
        return self.transformed(matrix)

    def with_material(self, material: int) -> "Mesh":
        return replace(self, materials=material)


def _floats(name: str, values: np.ndarray, tail: tuple[int, ...], count: int | None) -> np.ndarray:
    try:
        array = np.array(values, np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name}: no array of numbers; a mesh takes [n, {tail[0]}]") from None
    if array.ndim != 2 or array.shape[1:] != tail or count not in (None, len(array)) or not 0 < len(array) <= MOST:
        raise InputError(f"{name}: shape {array.shape}; a mesh takes [{count or 'n'}, {tail[0]}]")
    if not np.isfinite(array).all() or np.abs(array).max() > 1e18:
        raise InputError(f"{name}: not finite, or above 1e18; repair the mesh")
    return array


def _triangles(values: np.ndarray, n: int) -> np.ndarray:
    array = np.array(values)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu" or not 0 < len(array) <= MOST:
        raise InputError(f"triangles: {array.dtype} {array.shape}; a mesh takes whole numbers [m, 3], m at least 1")
    array = array.astype(np.int64)
    if array.min() < 0 or array.max() >= n:
        raise InputError(f"triangles: vertices {array.min()} to {array.max()}, and there are 0 to {n - 1}")
    return array


def _directed(normals: np.ndarray) -> np.ndarray:
    if not normals.any(axis=-1).all():
        raise InputError("normals: some have no length; leave them out, and they are made")
    return normals


def _materials(values: int | np.ndarray, m: int) -> np.ndarray:
    array = np.asarray(values)
    if array.dtype.kind not in "iu" or array.shape not in ((), (m,)):
        raise InputError(f"materials: {array.dtype} {array.shape}; give one number, or [{m}] of the triangles")
    require_whole("materials", array.min(), 0)
    require_whole("materials", array.max(), 0)
    return np.array(np.broadcast_to(array, m), np.int64)
