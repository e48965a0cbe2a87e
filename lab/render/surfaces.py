"""Surfaces as triangles: cleaned, cut open, and written as STL by ``trimesh``."""

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from lab.core.se3 import Array

__all__ = ["coarse", "halved", "mesh_of", "write_stl"]

_FINEST_CELLS = 128  # along the longest edge of a mesh, in which corners are merged


def mesh_of(vertices: Array, triangles: NDArray[np.int_]) -> trimesh.Trimesh:
    """A mesh of vertices ``(k, 3)`` m and triangles ``(f, 3)``, with those that have no area left out."""
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    if len(triangles):
        mesh.update_faces(mesh.nondegenerate_faces())
        mesh.merge_vertices()
    return mesh


def coarse(vertices: NDArray[np.floating], triangles: NDArray[np.integer], most: int) -> tuple[Array, NDArray[np.int_]]:
    """Merge the corners within each cell of a grid, as fine as leaves at most ``most`` triangles (at least 12).

    Returns:
        vertices ``(k, 3)`` m and triangles ``(f, 3)``; ``k`` is less than 65,536.
    """
    low, size = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max()) or 1.0
    cells = _FINEST_CELLS
    while True:
        grid = np.round((vertices - low) * (cells / size)).astype(np.int_)
        _, merged, count = np.unique(grid, axis=0, return_inverse=True, return_counts=True)
        merged = merged.ravel()
        corners = np.zeros((len(count), 3))
        np.add.at(corners, merged, vertices)
        faces = merged[triangles]
        a, b, c = faces.T
        faces = faces[(a != b) & (b != c) & (c != a)]
        if (len(faces) <= most and len(count) < 2**16) or cells <= 2:
            return corners / count[:, None], faces
        cells = int(cells / 1.4)


def halved(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Cut a mesh at its x-z plane and keep y >= 0, so that one looks into it; flat ones stay whole."""
    if not len(mesh.faces) or mesh.bounds[0, 1] >= 0:
        return mesh
    cut: trimesh.Trimesh = trimesh.intersections.slice_mesh_plane(mesh, (0.0, 1.0, 0.0), (0.0, 0.0, 0.0))  # type: ignore[no-untyped-call]
    return cut


def write_stl(path: Path, mesh: trimesh.Trimesh) -> None:
    """Write a mesh as binary STL, in metres."""
    path.write_bytes(trimesh.exchange.stl.export_stl(mesh))
