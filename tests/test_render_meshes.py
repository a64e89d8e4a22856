"""Built-in meshes are closed and smooth, attributes are as they should be, files are read or refused in a line."""

import sys
from collections import Counter

import numpy as np
import pytest

from warp_neural import InputError
from warp_neural.render import Mesh, floor, knob, load_mesh, sphere
from warp_neural.render.attributes import details, face_normals, tangents_of, unit

QUAD = """mtllib quad.mtl
v 0 0 0
v 2 0 0
v 2 3 0
v 0 3 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl first
f 1/1 2/2 3/3
usemtl second
f 1/1 3/3 4/4
"""
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""


def rotation() -> np.ndarray:
    """Some proper rotation."""
    q, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


@pytest.mark.parametrize("mesh", [sphere(columns=64), knob(columns=64)], ids=["sphere", "knob"])
def test_built_in_shapes_are_closed_and_face_outwards(mesh):
    _, place = np.unique(mesh.positions, axis=0, return_inverse=True)
    triangles = place.reshape(-1)[mesh.triangles]
    sides = Counter(map(tuple, np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])))
    assert all(count == 1 and sides[b, a] == 1 for (a, b), count in sides.items())  # each side once each way
    a, b, c = np.moveaxis(mesh.positions[mesh.triangles], 1, 0)
    assert (a * np.cross(b, c)).sum() > 0  # six times the volume
    assert mesh.positions[:, 1].min() == 0  # stands on the floor
    faces = unit(face_normals(mesh.positions, mesh.triangles))
    assert (faces[:, None] * mesh.normals[mesh.triangles]).sum(axis=-1).min() > 0.9
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-12)


def test_the_sphere_is_round():
    mesh = sphere(2.5)
    np.testing.assert_allclose(mesh.positions, 2.5 * (mesh.normals + np.array([0, 1, 0])), atol=1e-12)
    middles = mesh.positions[mesh.triangles].mean(axis=1) - [0, 2.5, 0]
    assert 1 - np.linalg.norm(middles, axis=1).min() / 2.5 < 2e-4  # of a picture 1000 pixels wide 0.1 pixel


def test_the_knobs_normals_are_those_of_its_outline():
    """Against triangles so fine that theirs tell."""
    mesh = knob(columns=1024)
    faces = unit(face_normals(mesh.positions, mesh.triangles))
    smooth = unit(mesh.normals[mesh.triangles].mean(axis=1))
    assert (faces * smooth).sum(axis=-1).min() > np.cos(np.radians(6))
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    np.testing.assert_allclose(high - low, [2, 2.5, 2], atol=0.02)


@pytest.mark.parametrize("mesh", [sphere(columns=64), knob(columns=64), floor()], ids=["sphere", "knob", "floor"])
def test_tangents_go_along_u_and_v(mesh):
    made = tangents_of(mesh.positions, mesh.normals, mesh.uvs, mesh.triangles)
    ring = np.abs(mesh.normals[:, 1]) < 0.9 if len(mesh.positions) > 4 else slice(None)  # at poles u has no direction
    assert (made[ring, :3] * mesh.tangents[ring, :3]).sum(axis=-1).min() > 0.99
    assert (made[ring, 3] == mesh.tangents[ring, 3]).all()
    a, b, c = np.moveaxis(mesh.positions[mesh.triangles], 1, 0)
    ua, ub, uc = np.moveaxis(mesh.uvs[mesh.triangles], 1, 0)
    n, t = mesh.normals[mesh.triangles[:, 0]], mesh.tangents[mesh.triangles[:, 0]]
    along_v = t[:, 3:] * np.cross(n, t[:, :3])
    inside = np.abs(n[:, 1]) < 0.9 if len(mesh.positions) > 4 else slice(None)
    for e, f in ((b - a, ub - ua), (c - a, uc - ua)):  # u and v rise where a side goes along them
        u, v = (unit(e) * t[:, :3]).sum(axis=-1), (unit(e) * along_v).sum(axis=-1)
        assert ((u > -0.1) | (f[:, 0] < 0))[inside].all() and ((u < 0.1) | (f[:, 0] > 0))[inside].all()
        assert ((v > -0.1) | (f[:, 1] < 0))[inside].all() and ((v < 0.1) | (f[:, 1] > 0))[inside].all()


def test_missing_attributes_are_made():
    given = sphere(columns=64)
    mesh = Mesh(given.positions, given.triangles, uvs=given.uvs)
    assert (mesh.normals * unit(mesh.positions - [0, 1, 0])).sum(axis=-1).min() > 0.999
    assert len(mesh.positions) == len(np.unique(given.triangles))  # nothing is split
    bare = Mesh(given.positions, given.triangles)
    np.testing.assert_allclose((bare.tangents[:, :3] * bare.normals).sum(axis=-1), 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(bare.tangents[:, :3], axis=-1), 1, atol=1e-12)


def test_creases_stay_sharp():
    """A cube of eight vertices, and the same with so many triangles at a corner that they are taken as smooth."""
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")).reshape(3, -1).T
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))])
    mesh = Mesh(corners, triangles)
    assert len(mesh.positions) == 24
    faces = unit(face_normals(mesh.positions, mesh.triangles))
    np.testing.assert_allclose(mesh.normals[mesh.triangles], np.repeat(faces[:, None], 3, axis=1), atol=1e-12)
    many = Mesh(corners, np.repeat(triangles, 1300, axis=0))
    assert len(many.positions) == 8
    np.testing.assert_allclose(many.normals, unit(many.positions - 0.5), atol=1e-12)


def test_mirrored_textures_do_not_share_vertices():
    """Two triangles on one side, the second with the first's texture turned over."""
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    mesh = Mesh(positions, np.array([[0, 1, 2], [2, 1, 3]]), uvs=np.array([[0, 0], [1, 0], [0, 1], [0, 0]]))
    assert len(mesh.positions) == 6
    first, second = (mesh.tangents[triangle] for triangle in mesh.triangles)
    assert (first[:, 3] == 1).all() and (second[:, 3] == -1).all()
    np.testing.assert_allclose(first[:, :3], np.tile([1.0, 0, 0], (3, 1)), atol=1e-12)
    np.testing.assert_allclose(second[:, :3], np.tile([0.0, -1, 0], (3, 1)), atol=1e-12)


def test_details_of_a_sphere():
    """Curvature 1 / radius; a texture twice around the equator."""
    mesh = sphere(2.0)
    detail = details(mesh.positions, mesh.normals, mesh.uvs, mesh.triangles)
    np.testing.assert_allclose(detail[:, 1], 0.5, rtol=1e-3)
    equator = np.abs(mesh.normals[mesh.triangles[:, 0], 1]) < 0.02
    np.testing.assert_allclose(detail[equator, 0], np.log2(2 / (2 * np.pi * 2)), atol=0.01)


@pytest.mark.parametrize("mirror", [1, -1])
def test_transforms_keep_attributes_in_step(mirror):
    given = Mesh(*(getattr(knob(columns=32), name) for name in ("positions", "triangles", "normals", "uvs")))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation() @ np.diag([mirror * 2.0, 0.7, 1.3]), (1, 2, 3)
    mesh = given.transformed(matrix)
    np.testing.assert_allclose(mesh.positions, given.positions @ matrix[:3, :3].T + [1, 2, 3])
    faces = unit(face_normals(mesh.positions, mesh.triangles))
    assert (faces[:, None] * mesh.normals[mesh.triangles]).sum(axis=-1).min() > 0.5  # still outwards
    made = tangents_of(mesh.positions, mesh.normals, mesh.uvs, mesh.triangles)
    ring = np.abs(given.normals[:, 1]) < 0.9
    assert (made[ring, 3] == mesh.tangents[ring, 3]).all()
    assert (made[ring, :3] * mesh.tangents[ring, :3]).sum(axis=-1).min() > 0.95
    turned = sphere(columns=16).moved((5, 0, 0), scale=2, turn=90)
    np.testing.assert_allclose(turned.positions.min(axis=0), [3, 0, -2], atol=1e-9)
    assert floor(material=3).with_material(5).materials.tolist() == [5, 5]


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"positions": np.zeros((3, 2))}, "positions"),
        ({"positions": np.full((3, 3), np.nan)}, "not finite"),
        ({"positions": [["a"]]}, "no array of numbers"),
        ({"triangles": np.array([[0, 1, 3]])}, "vertices 0 to 3, and there are 0 to 2"),
        ({"triangles": np.array([[0, 1, -1]])}, "vertices -1"),
        ({"triangles": np.zeros((0, 3), int)}, "at least 1"),
        ({"triangles": np.zeros((1, 3))}, "whole numbers"),
        ({"normals": np.zeros((3, 3))}, "no length"),
        ({"uvs": np.zeros((4, 2))}, "uvs"),
        ({"materials": -1}, "materials"),
        ({"materials": np.array([1, 2])}, "materials"),
    ],
)
def test_bad_meshes_are_refused(changes, message):
    given = {"positions": np.eye(3), "triangles": np.array([[0, 1, 2]])}
    with pytest.raises(InputError, match=message):
        Mesh(**(given | changes))


def test_a_matrix_that_flattens_is_refused():
    for matrix in (np.diag([1.0, 1, 0]), np.full((4, 4), np.inf), np.eye(2)):
        with pytest.raises(InputError, match="matrix"):
            floor().transformed(matrix)


def test_obj_and_ply_are_read(tmp_path):
    pytest.importorskip("trimesh", reason="trimesh is not installed")
    (tmp_path / "quad.obj").write_text(QUAD)
    (tmp_path / "quad.mtl").write_text("newmtl first\nKd 1 0 0\nnewmtl second\nKd 0 1 0\n")
    mesh = load_mesh(tmp_path / "quad.obj")
    assert mesh.materials.tolist() == [0, 1]
    np.testing.assert_allclose(mesh.positions.max(axis=0), [2, 3, 0])
    np.testing.assert_allclose(mesh.normals, np.tile([0.0, 0, 1], (len(mesh.normals), 1)), atol=1e-6)
    np.testing.assert_allclose(mesh.uvs[:, 1], mesh.positions[:, 1] / 3, atol=1e-6)  # up the picture
    np.testing.assert_allclose(mesh.uvs[:, 0], mesh.positions[:, 0] / 2, atol=1e-6)
    assert (mesh.tangents[:, 3] == 1).all()
    (tmp_path / "triangle.ply").write_text(PLY)
    assert load_mesh(tmp_path / "triangle.ply", material=4).materials.tolist() == [4]


def test_gltf_is_read_as_it_was_written(tmp_path):
    """With the normals of the file, and the places of its nodes."""
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    given = sphere(columns=16)
    normals = unit(given.normals + np.array([0.3, 0, 0]))
    visual = trimesh.visual.TextureVisuals(uv=given.uvs)
    part = trimesh.Trimesh(given.positions, given.triangles, vertex_normals=normals, visual=visual, process=False)
    place = np.eye(4)
    place[:3, 3] = 1, 2, 3
    scene = trimesh.Scene()
    scene.add_geometry(part, transform=place)
    scene.export(tmp_path / "ball.glb", include_normals=True)
    mesh = load_mesh(tmp_path / "ball.glb")
    for name, wanted in (("positions", given.positions + place[:3, 3]), ("uvs", given.uvs), ("normals", normals)):
        read = getattr(mesh, name)[mesh.triangles]
        np.testing.assert_allclose(read, wanted[given.triangles], atol=1e-5, err_msg=name)  # of float32


@pytest.mark.parametrize("suffix", ["glb", "gltf", "obj", "ply"])
def test_damaged_files_are_refused_in_one_line(suffix, tmp_path):
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    ball = trimesh.creation.icosphere(subdivisions=1)
    path = tmp_path / f"ball.{suffix}"
    whole = ball.export(file_type=suffix)
    whole = whole["model.gltf"] if isinstance(whole, dict) else whole  # without its buffers
    whole = whole.encode() if isinstance(whole, str) else whole
    random = np.random.default_rng(0)
    damaged = [b"", b"\0" * 100, whole[:40], whole[: len(whole) // 2] * (suffix != "obj")]
    for _ in range(12):
        noise = bytearray(whole)
        for at in random.integers(0, len(whole), 30):
            noise[at] = random.integers(256)
        damaged.append(bytes(noise))
    refused = 0
    for data in damaged:
        path.write_bytes(data)
        try:
            load_mesh(path)
        except InputError as error:
            refused += 1
            assert str(error).startswith(str(path)) and "\n" not in str(error) and len(str(error)) < 500
    assert refused >= 3  # noise in a coordinate is a mesh too


def test_what_is_no_mesh_file_is_refused(tmp_path, monkeypatch):
    pytest.importorskip("trimesh", reason="trimesh is not installed")
    with pytest.raises(InputError, match=r"none\.obj: no file"):
        load_mesh(tmp_path / "none.obj")
    with pytest.raises(InputError, match="unknown suffix"):
        load_mesh(tmp_path / "none.stl")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\n")
    with pytest.raises(InputError, match="no triangles"):
        load_mesh(tmp_path / "points.obj")
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(InputError, match="pip install"):
        load_mesh(tmp_path / "points.obj")
