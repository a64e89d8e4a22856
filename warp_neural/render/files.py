"""Meshes from glTF, OBJ and PLY, by `trimesh`."""

from pathlib import Path
from typing import Any

import numpy as np

from warp_neural.errors import InputError
from warp_neural.render.mesh import Mesh

SUFFIXES = ".glb", ".gltf", ".obj", ".ply"
MAX_BYTES = 2**31


def load_mesh(path: Path | str, *, material: int | None = None) -> Mesh:
    """All triangles of a file, in its own units and axes (glTF's are ours: metres, y up, z towards the viewer).

    material: of all of them; by default parts with the file's first material have 0, with the next 1, and so on. What
    its materials look like is not read. Normals are made where one is missing. Raises `InputError` for a file that is
    missing, damaged or without triangles.
    """
    path = Path(path)
    parts = _parts(path)
    meshes, names = zip(*parts, strict=True)
    order = list(dict.fromkeys(names))
    first = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    attributes = {
        name: np.concatenate([getattr(mesh, name) for mesh in meshes])
        for name in ("positions", "normals", "uvs", "tangents")
    }
    numbers = [np.full(len(mesh.triangles), order.index(name)) for mesh, name in parts]
    return Mesh(
        **attributes,
        triangles=np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, first[:-1], strict=True)]),
        materials=np.concatenate(numbers) if material is None else material,
    )


def _parts(path: Path) -> list[tuple[Mesh, str]]:
    """Each mesh in the scene's space, and the name of its material."""
    try:
        import trimesh
    except ImportError:
        raise InputError(
            f"{path}: meshes are read by trimesh, which is not here; pip install 'warp-neural[meshes]'"
        ) from None
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: unknown suffix {path.suffix!r}; use one of {', '.join(SUFFIXES)}")
    parts = []
    try:
        if not path.is_file() or path.stat().st_size > MAX_BYTES:
            raise InputError("no file, or too large; check the name")
        with np.errstate(all="ignore"):
            scene = trimesh.load_scene(path, process=False)
            for node in scene.graph.nodes_geometry:
                matrix, name = scene.graph[node]
                part = scene.geometry[name]
                if isinstance(part, trimesh.Trimesh) and len(part.faces):
                    parts.append((_mesh(part).transformed(matrix), _material_name(part)))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:  # whatever a damaged file makes trimesh and what it calls raise
        detail = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise InputError(f"{path}: cut short or damaged ({detail}); export it again") from None
    if not parts:
        raise InputError(f"{path}: holds no triangles; export the mesh with its faces")
    return parts


def _mesh(part: Any) -> Mesh:
    positions, triangles = np.array(part.vertices, np.float64), np.array(part.faces, np.int64)
    normals = None
    if "vertex_normals" in part._cache:  # the file's; those that trimesh makes show the seams of textures
        normals = np.array(part.vertex_normals, np.float64)
        normals = normals if normals.any(axis=-1).all() else None
    uvs = getattr(part.visual, "uv", None)
    if uvs is None or len(uvs) != len(positions):
        uvs = np.zeros((len(positions), 2))
    return Mesh(positions, triangles, normals, np.array(uvs, np.float64)[:, :2])  # trimesh's v goes up, as ours


def _material_name(part: Any) -> str:
    return str(getattr(getattr(part.visual, "material", None), "name", None))
