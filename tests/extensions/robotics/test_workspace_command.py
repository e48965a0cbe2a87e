"""``lab workspace``: sizes, orientations, sections, a cell, and what is refused."""

import json

import numpy as np
import pytest
import trimesh

from lab.cli.main import main


def run(capsys, *arguments: object) -> tuple[int, dict, str]:
    code = main(["workspace", *map(str, arguments), "--json"])
    said = capsys.readouterr()
    return code, json.loads(said.out) if said.out else {}, said.err


def test_a_scara_chooses_turns_about_its_axis_everywhere(capsys) -> None:
    """Its hand turns by ±180° whatever the arm does: every turn is reached, and it has no other to choose."""
    code, seen, _ = run(capsys, "scara", "--places", 300, "--orientations", 8)
    (one,) = seen["workspaces"]
    assert code == 0 and one["orientations"]["about"] == [0, 0, 1]
    assert one["orientations"]["mean_share"] == one["orientations"]["all_reached_share"] == 1.0
    assert one["reach_mm"] == pytest.approx(650) and one["method"] == "Monte Carlo"
    low, high = one["extents_mm"]["z"]
    assert high - low == pytest.approx(200, abs=1e-6)


@pytest.mark.thorough
@pytest.mark.figures
def test_the_folder_has_the_boundary_as_a_mesh_and_every_carrier(capsys, tmp_path) -> None:
    code, seen, _ = run(capsys, "carrier/cylindrical", "carrier/cartesian", "--places", 300, "--out", tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert code == 0 and [each["robot"] for each in seen["workspaces"]] == ["carrier-cylindrical", "carrier-cartesian"]
    assert names >= {"report.html", "workspace.csv", "carrier-cartesian.stl"}
    mesh = trimesh.load_mesh(tmp_path / "out" / "carrier-cylindrical.stl")
    assert mesh.volume == pytest.approx(np.pi, rel=0.03)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Sizes of the workspaces" in page and page.count("Section x-z") >= 2


@pytest.mark.thorough
def test_in_a_cell_a_wall_takes_places_away(capsys, tmp_path) -> None:
    shares, wall = [], tmp_path / "cell.toml"
    for y_mm in (-5000, -150):
        wall.write_text(
            f'name = "wall"\n[[obstacle]]\nname = "wall"\nshape = "box"\nsize_mm = [2000, 20, 2000]\n'
            f"position_mm = [0, {y_mm}, 1000]\n"
        )
        code, seen, _ = run(capsys, "scara", "--cell", wall, "--places", 200, "--orientations", 1)
        (one,) = seen["workspaces"]
        assert code == 0 and one["cell"]["name"] == "wall"
        assert one["cell"]["free_size"] == pytest.approx(one["cell"]["free_share"] * one["volume_m3"])
        shares.append(one["cell"]["free_share"])
    assert 0.3 < shares[1] < shares[0] - 0.03  # of the same places; with the hand drawn up the arm touches itself


def test_what_cannot_be_measured_is_one_line(capsys, tmp_path) -> None:
    for arguments, words in (
        (("course2r",), "stays on a surface"),
        (("irb120", "--places", 5), "--places 5"),
        (("irb120", "--orientations", 0), "--orientations 0"),
        (("irb120", "--tool-mm", "1,2"), "--tool-mm"),
        (("irb120", "tx40", "--cell", tmp_path / "cell.toml"), "--cell"),
        (("nothing",), "no such model"),
    ):
        code, _, err = run(capsys, *arguments)
        assert code == 2 and words in err and len(err.strip().splitlines()) == 1, arguments
