"""Extract the surface of a volume as coloured triangles: marching cubes (Lewiner et al. 2003, by scikit-image), piece by piece.

A piece is a cube of PIECE^3 blocks of the volume, so that the dense arrays of marching cubes stay small.
"""

from __future__ import annotations

import itertools

import numpy as np
import trimesh
from skimage.measure import marching_cubes

from radartwin.compiled import compiled
from radartwin.errors import ScanError
from radartwin.reconstruct.fusion.volume import SIDE, Volume

PIECE = 8  # number of blocks along the edge of a piece: marching cubes gets 65^3 samples at a time
CORNERS = tuple(itertools.product((slice(None, -1), slice(1, None)), repeat=3))  # the eight corners of all cubes of an array
GREY = 128  # colour of vertices that no colour picture shows


def extract(volume: Volume, min_weight: float) -> tuple[trimesh.Trimesh, np.ndarray]:
    """Extract triangles that face free space from a volume, where the signed distance changes its sign.

    Args:
        min_weight: smallest weight W(x) of observed voxels; a cube of eight voxels gives triangles only if all eight have this weight.
    Returns:
        The mesh with RGBA vertex colours, and a boolean mask (V,) of the vertices that a colour picture shows.
    Raises:
        ScanError: the volume contains no surface.
    """
    side = PIECE * SIDE + 1
    values, weights = np.empty((side, side, side), np.float32), np.empty((side, side, side), np.float32)
    vertices, faces, count = [], [], 0
    for piece in np.unique(volume.blocks // PIECE, axis=0):
        _gather(volume.slot, volume.sdf, volume.weight, piece * PIECE, values, weights)
        # The mask marks a cube with eight observed corners at its corner with the largest indices, as scikit-image expects.
        seen = np.zeros_like(weights, dtype=bool)
        observed = weights >= min_weight
        seen[1:, 1:, 1:] = np.all([observed[corner] for corner in CORNERS], axis=0)
        near = values[weights > 0]
        if not seen.any() or near.min() > 0 or near.max() < 0:
            continue
        try:
            corners, triangles, _, _ = marching_cubes(values, 0.0, mask=seen, gradient_direction="descent", allow_degenerate=False)
        except RuntimeError:  # scikit-image found no zero crossing inside the mask
            continue
        vertices.append(corners + piece * PIECE * SIDE)
        faces.append(triangles + count)
        count += len(corners)
    if not count:
        raise ScanError("no surface is visible in enough frames; check that poses and depth belong to the same scan")
    mesh = trimesh.Trimesh(np.vstack(vertices), np.vstack(faces), process=False)
    mesh.merge_vertices(digits_vertex=4)  # coordinates are in voxels here; merging closes the seams between pieces
    mesh.update_faces(mesh.nondegenerate_faces(height=1e-4))
    mesh.remove_unreferenced_vertices()
    cells = np.asarray(mesh.vertices)
    colours, coloured = _colours(cells, volume.slot, volume.colour, volume.colour_weight)
    places = cells * volume.voxel_m + volume.origin
    return trimesh.Trimesh(places, mesh.faces, vertex_colors=colours, process=False), coloured


@compiled
def _gather(slot, sdf, weight, block, values, weights):
    """Copy the voxels of the piece that starts at `block` (3,) to `values` and `weights`. Unobserved voxels get weight 0 and distance 1."""
    values[:] = 1.0
    weights[:] = 0.0
    side = values.shape[0]
    for i in range(side // SIDE + 1):
        for j in range(side // SIDE + 1):
            for k in range(side // SIDE + 1):
                a, b, c = block[0] + i, block[1] + j, block[2] + k
                if a >= slot.shape[0] or b >= slot.shape[1] or c >= slot.shape[2] or slot[a, b, c] < 0:
                    continue
                s = slot[a, b, c]
                for x in range(min(SIDE, side - i * SIDE)):
                    for y in range(min(SIDE, side - j * SIDE)):
                        for z in range(min(SIDE, side - k * SIDE)):
                            if weight[s, x, y, z] > 0:
                                values[i * SIDE + x, j * SIDE + y, k * SIDE + z] = sdf[s, x, y, z]
                                weights[i * SIDE + x, j * SIDE + y, k * SIDE + z] = weight[s, x, y, z]


@compiled
def _colours(cells, slot, colour, colour_weight):
    """Return the colours (N, 3) at vertices (N, 3) in units of voxels, and a mask (N,) of those with a coloured voxel around them."""
    out = np.full((len(cells), 3), GREY, np.uint8)
    known = np.zeros(len(cells), np.bool_)
    for p in range(len(cells)):
        i0, j0, k0 = int(np.floor(cells[p, 0])), int(np.floor(cells[p, 1])), int(np.floor(cells[p, 2]))
        total, red, green, blue = 0.0, 0.0, 0.0, 0.0
        for c in range(8):
            i, j, k = i0 + (c >> 2), j0 + ((c >> 1) & 1), k0 + (c & 1)
            if i // SIDE >= slot.shape[0] or j // SIDE >= slot.shape[1] or k // SIDE >= slot.shape[2]:
                continue
            s = slot[i // SIDE, j // SIDE, k // SIDE]
            if s < 0 or colour_weight[s, i % SIDE, j % SIDE, k % SIDE] <= 0:
                continue
            w = (1.01 - abs(cells[p, 0] - i)) * (1.01 - abs(cells[p, 1] - j)) * (1.01 - abs(cells[p, 2] - k))
            total += w
            red += w * colour[s, i % SIDE, j % SIDE, k % SIDE, 0]
            green += w * colour[s, i % SIDE, j % SIDE, k % SIDE, 1]
            blue += w * colour[s, i % SIDE, j % SIDE, k % SIDE, 2]
        if total > 0:
            out[p, 0], out[p, 1], out[p, 2] = int(red / total + 0.5), int(green / total + 0.5), int(blue / total + 0.5)
            known[p] = True
    return out, known
