"""Build meshes of rooms with triangles as small as those of a scanner, and the true scene of each room."""

import numpy as np
import trimesh

from radartwin.scene.rooms import rectangle
from radartwin.scene.scene import Scene, Surface

EDGE_M = 0.05
SIZE = (5.0, 4.0, 2.4)
WINDOW = (1.0, 0.9, 2.2, 1.9)  # window in the wall y = 4: first x, lower z, last x, upper z in metres
DOOR = (1.0, 0.0, 1.9, 2.0)  # door in the wall x = 5
WHITE, BROWN, GREY = (220, 220, 215), (120, 80, 50), (150, 150, 155)
X, Y, Z = np.eye(3)
L, W, H = SIZE


def sheet(corner, along, up, size, hole=None, edge_m=EDGE_M):
    """Return a flat grid of triangles that faces along x up (cross product), without the triangles inside the hole (u0, v0, u1, v1)."""
    nu, nv = (round(s / edge_m) for s in size)
    u, v = np.meshgrid(np.linspace(0, size[0], nu + 1), np.linspace(0, size[1], nv + 1), indexing="ij")
    points = np.asarray(corner, float) + u[..., None] * np.asarray(along) + v[..., None] * np.asarray(up)
    grid = np.arange(u.size).reshape(u.shape)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2)
    if hole is not None:
        cu, cv = (u[:-1, :-1] + u[1:, 1:]) / 2, (v[:-1, :-1] + v[1:, 1:]) / 2
        faces = faces[~((cu > hole[0]) & (cu < hole[2]) & (cv > hole[1]) & (cv < hole[3]))]
    return trimesh.Trimesh(points.reshape(-1, 3), faces.reshape(-1, 3), process=False)


def block(size, centre):
    """Return a box of triangles that are about as small as those of `sheet`."""
    box = trimesh.creation.box(size).subdivide_to_size(EDGE_M)
    assert isinstance(box, trimesh.Trimesh)
    return box.apply_translation(centre)


def modelled(rows=17, columns=17, seed=0):
    """Return a room of small faces as from a modelling program, in which boxes of few heights stand in rows."""
    rng = np.random.default_rng(seed)
    room = trimesh.creation.box(bounds=[[0, 0, 0], [0.9 * columns + 0.5, 0.9 * rows + 0.5, 3]])
    room.invert()
    pieces = [room.subdivide().subdivide().subdivide().subdivide().subdivide()]
    for row, column in np.ndindex(rows, columns):
        width, depth, height = rng.choice([0.4, 0.5, 0.6]), rng.choice([0.4, 0.5, 0.6]), rng.choice([0.45, 0.75, 1.1, 1.8])
        box = trimesh.creation.box((width, depth, height)).subdivide().subdivide()
        box.apply_transform(trimesh.transformations.rotation_matrix(rng.choice([0, 0, 0, 0.3, 0.9]), Z))
        pieces.append(box.apply_translation([0.7 + 0.9 * column, 0.7 + 0.9 * row, height / 2 + rng.choice([0, 0.02, 0.2])]))
    whole = trimesh.util.concatenate(pieces)
    assert isinstance(whole, trimesh.Trimesh)
    return whole


def inner_sides(size):
    """Return corner, two directions and two extents of each of the six sides of a box, seen from inside."""
    x, y, z = size
    return [
        ((0, 0, 0), X, Y, (x, y)),
        ((0, y, z), X, -Y, (x, y)),
        ((0, 0, 0), Y, Z, (y, z)),
        ((x, y, 0), -Y, Z, (y, z)),
        ((x, 0, 0), -X, Z, (x, z)),
        ((0, y, 0), X, Z, (x, z)),
    ]


def shell(window=None):
    *others, last = inner_sides(SIZE)
    return [*(sheet(*side) for side in others), sheet(*last, hole=window)]


def scan(pieces, noise_m=0.0, seed=0):
    """Weld the pieces to one mesh, and add noise that is smooth over two triangle edges, as the depth noise of a scanner is."""
    mesh = trimesh.util.concatenate(pieces)
    assert isinstance(mesh, trimesh.Trimesh)
    mesh = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    mesh.merge_vertices(digits_vertex=6)
    noise = noise_m * np.random.default_rng(seed).standard_normal(mesh.vertices.shape)
    return trimesh.Trimesh(mesh.vertices + noise, mesh.faces, process=False)


def saved(mesh, tmp_path, name="room.ply"):
    mesh.export(tmp_path / name)
    return tmp_path / name


def truth():
    """Return the scene of the room, in which the window is a pane of glass."""
    *others, last = inner_sides(SIZE)
    meshes = [*(rectangle(*side) for side in others), rectangle(*last, openings=[WINDOW])]
    facts = {"source": "true", "minc": "painted"}
    surfaces = [Surface(mesh, "plasterboard", f"side_{k}", role="room", provenance=facts) for k, mesh in enumerate(meshes)]
    pane = rectangle(*last, inset=WINDOW)
    return Scene([*surfaces, Surface(pane, "glass", "window", role="room", provenance={"source": "true", "minc": "glass"})])


def coloured(mesh, rule, seed=0):
    """Return a copy of the mesh with the vertex colours rule(vertices) -> (V, 3) and some colour noise."""
    rgb = np.array([rule(v) for v in mesh.vertices], dtype=float)
    rgb += np.random.default_rng(seed).normal(0, 4, rgb.shape)
    rgba = np.column_stack([np.clip(rgb, 0, 255), np.full(len(rgb), 255)]).astype(np.uint8)
    return trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_colors=rgba, process=False)


def with_door(v):
    u = W - v[1]
    light = 1.0 - 0.25 * v[2] / H  # brightness that decreases with height without an edge
    inside = v[0] > L - 0.05 and DOOR[0] < u < DOOR[2] and v[2] < DOOR[3]
    return np.array(BROWN if inside else WHITE) * light
