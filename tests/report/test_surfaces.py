"""Surfaces of triangles: without flat ones, cut open, written and read again."""

import numpy as np
import pytest
import trimesh

from lab.report.surfaces import halved, mesh_of, write_stl


def test_a_ball_is_cut_open_and_written(tmp_path) -> None:
    ball = trimesh.creation.icosphere(3, 2.0)
    triangles = np.concatenate([ball.faces, [[0, 0, 1]]])  # the last has no area
    mesh = mesh_of(np.add(ball.vertices, (0.0, 0.1, 0.0)), triangles)
    assert len(mesh.faces) == len(ball.faces) and mesh.volume == pytest.approx(ball.volume)
    half = halved(mesh)
    assert half.bounds[0, 1] == pytest.approx(0.0, abs=1e-9) and half.area == pytest.approx(0.525 * mesh.area, rel=0.01)
    write_stl(tmp_path / "ball.stl", mesh)
    assert trimesh.load_mesh(tmp_path / "ball.stl").volume == pytest.approx(mesh.volume, rel=1e-5)
    assert len(halved(mesh_of(np.empty((0, 3)), np.empty((0, 3), dtype=int))).faces) == 0  # an area has none
