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
    its materials look like is not read. Without normals they are made smooth. Raises `InputError` for a file that is
    missing, damaged or without triangles.
    """
    path = Path(path)
    parts = [_part(part) for part in _parts(path)]
    names = list(dict.fromkeys(name for *_, name in parts))
    first = np.cumsum([0, *(len(positions) for positions, *_ in parts)])
    triangles = [part[1] + start for part, start in zip(parts, first[:-1], strict=True)]
    materials = [np.full(len(part[1]), names.index(part[-1])) for part in parts]
    try:
        return Mesh(
            positions=np.concatenate([part[0] for part in parts]),
            triangles=np.concatenate(triangles),
            normals=np.concatenate([part[2] for part in parts]),
            uvs=np.concatenate([part[3] for part in parts]),
            materials=np.concatenate(materials) if material is None else material,
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _parts(path: Path) -> list[Any]:
    """`trimesh.Trimesh` of each part, in the scene's space."""
    try:
        import trimesh
    except ImportError:
        raise InputError(f"{path}: meshes are read by trimesh, which is not here; pip install trimesh") from None
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: unknown suffix {path.suffix!r}; use one of {', '.join(SUFFIXES)}")
    try:
        if not path.is_file() or path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: no file, or larger than {MAX_BYTES} bytes; check the name")
        with np.errstate(all="ignore"):
            loaded = trimesh.load_scene(path, process=False)
            parts = [part for part in loaded.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    except InputError:
        raise
    except Exception as error:  # whatever a damaged file makes trimesh and what it calls raise
        detail = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise InputError(f"{path}: cut short or damaged ({detail}); export it again") from None
    if not parts:
        raise InputError(f"{path}: holds no triangles; export the mesh with its faces")
    return parts


def _part(part: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, str]:
    """positions, triangles, normals, uvs, the name of its material"""
    positions, triangles = np.asarray(part.vertices, np.float64), np.asarray(part.faces, np.int64)
    uvs = getattr(part.visual, "uv", None)
    uvs = np.zeros((len(positions), 2)) if uvs is None or len(uvs) != len(positions) else np.array(uvs, np.float64)
    uvs[:, 1] = 1 - uvs[:, 1]  # trimesh counts v up the picture
    return positions, triangles, np.array(part.vertex_normals), uvs[:, :2], material_name(part)


def material_name(part: Any) -> str:
    material = getattr(part.visual, "material", None)
    return str(getattr(material, "name", None))
