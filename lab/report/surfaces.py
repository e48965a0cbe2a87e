"""Surfaces as triangles: cleaned, cut open, and written as STL by ``trimesh``."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array

if TYPE_CHECKING:
    import trimesh

__all__ = ["halved", "mesh_of", "write_stl"]


def mesh_of(vertices: Array, triangles: NDArray[np.int_]) -> "trimesh.Trimesh":
    """A mesh of vertices ``(k, 3)`` m and triangles ``(f, 3)``, with those that have no area left out."""
    import trimesh  # which takes most of a second

    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    if len(triangles):
        mesh.update_faces(mesh.nondegenerate_faces())
        mesh.merge_vertices()
    return mesh


def halved(mesh: "trimesh.Trimesh") -> "trimesh.Trimesh":
    """Cut a mesh at its x-z plane and keep y >= 0, so that one looks into it; flat ones stay whole."""
    if not len(mesh.faces) or mesh.bounds[0, 1] >= 0:
        return mesh
    import trimesh

    cut: trimesh.Trimesh = trimesh.intersections.slice_mesh_plane(mesh, (0.0, 1.0, 0.0), (0.0, 0.0, 0.0))  # type: ignore[no-untyped-call]
    return cut


def write_stl(path: Path, mesh: "trimesh.Trimesh") -> None:
    """Write a mesh as binary STL, in metres."""
    import trimesh

    path.write_bytes(trimesh.exchange.stl.export_stl(mesh))
