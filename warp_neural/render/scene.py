"""`Scene`: meshes together, with the tree that rays go through, on any device."""

from collections.abc import Iterable

import numpy as np
import warp as wp

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.render.geometry import Geometry
from warp_neural.render.attributes import details
from warp_neural.render.mesh import MOST, Mesh

EPSILON = 2.0e-6  # of the scene's extent: about thirty roundings of a coordinate


class Scene:
    """What is seen: meshes, each triangle with the number of its material."""

    def __init__(self, meshes: Iterable[Mesh]):
        self.meshes = tuple(meshes)
        if not self.meshes or not all(isinstance(mesh, Mesh) for mesh in self.meshes):
            raise InputError("scene: give at least one wn.render.Mesh, as sphere() and load_mesh(path) make them")
        if sum(len(mesh.triangles) for mesh in self.meshes) > MOST:
            raise InputError(f"scene: more than {MOST} triangles; simplify the meshes")
        self._data: dict[str, tuple[Geometry, wp.Mesh]] = {}

    def __repr__(self) -> str:
        return f"Scene({', '.join(map(repr, self.meshes))})"

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The least and the largest coordinates, [3] each."""
        low = np.min([mesh.positions.min(axis=0) for mesh in self.meshes], axis=0)
        return low, np.max([mesh.positions.max(axis=0) for mesh in self.meshes], axis=0)

    @property
    def material_count(self) -> int:
        return int(max(mesh.materials.max() for mesh in self.meshes)) + 1

    def data(self, device: wp.DeviceLike = None) -> Geometry:
        """For kernels, valid while this scene lives; made once for each device."""
        device = find_device(device)
        if device.alias not in self._data:
            self._data[device.alias] = self._made(device)
        return self._data[device.alias][0]

    def _made(self, device: wp.Device) -> tuple[Geometry, wp.Mesh]:
        def joined(name: str, dtype: type) -> wp.array:
            return wp.array(np.concatenate([getattr(m, name) for m in self.meshes]), dtype=dtype, device=device)

        first = np.cumsum([0, *(len(mesh.positions) for mesh in self.meshes)])
        triangles = np.concatenate([mesh.triangles + n for mesh, n in zip(self.meshes, first[:-1], strict=True)])
        geometry = Geometry()
        geometry.points, geometry.normals = joined("positions", wp.vec3), joined("normals", wp.vec3)
        geometry.tangents, geometry.uvs = joined("tangents", wp.vec4), joined("uvs", wp.vec2)
        geometry.materials = joined("materials", int)
        geometry.indices = wp.array(triangles.reshape(-1), dtype=int, device=device)
        detail = [details(mesh.positions, mesh.normals, mesh.uvs, mesh.triangles) for mesh in self.meshes]
        geometry.detail = wp.array(np.concatenate(detail), dtype=wp.vec2, device=device)
        low, high = self.bounds
        geometry.epsilon = EPSILON * float(max(np.abs(low).max(), np.abs(high).max(), (high - low).max()))
        mesh = wp.Mesh(points=geometry.points, indices=geometry.indices)
        geometry.mesh = mesh.id
        return geometry, mesh
