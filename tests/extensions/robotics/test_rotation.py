"""Rotations of ``lab kinematics``: the course's, every description back to the same matrix, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

import lab
from lab.cli.main import main
from lab.core.errors import LabError

rotation = lab.convert_rotation


def course(z: float, y: float, x: float) -> np.ndarray:
    """Mallem 2011, annex A3.2, the product as it is printed."""
    (cx, cy, cz), (sx, sy, sz) = np.cos((x, y, z)), np.sin((x, y, z))
    return np.array([
        [cy * cz, sx * sy * cz - cx * sz, cx * sy * cz + sx * sz],
        [cy * sz, sx * sy * sz + cx * cz, cx * sy * sz - sx * cz],
        [-sy, sx * cy, cx * cy],
    ])  # fmt: skip


def test_roll_pitch_yaw_is_the_course_s() -> None:
    found = rotation(angles=(30, 20, 10)).to_dict()
    np.testing.assert_allclose(found["matrix"], course(*np.deg2rad([30, 20, 10])), rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["orders"]["zyx"]["solutions"], [[30, 20, 10], [-150, 160, -170]], atol=1e-6)
    assert found["orders"]["zyx"]["determined"] == ""


def test_axis_and_angle_are_the_course_s() -> None:
    """Annex A3.5 for the axis of A3.4, and A3.7 and A3.8 back; both solutions."""
    alpha, beta, theta = 0.7, 1.1, 0.5
    u = np.array([np.sin(alpha) * np.sin(beta), -np.cos(alpha) * np.sin(beta), np.cos(beta)])
    c, s = np.cos(theta), np.sin(theta)
    cross = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
    R = np.outer(u, u) * (1 - c) + c * np.eye(3) + s * cross
    found = rotation(axis=tuple((3 * u).tolist()), angle=theta, radians=True).to_dict()
    np.testing.assert_allclose(found["matrix"], R, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["axis"], u, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["axis_angles"], [[alpha, beta], [alpha - np.pi, -beta]], rtol=0, atol=1e-9)
    assert found["angle"] == pytest.approx(np.arccos((np.trace(R) - 1) / 2)) and found["unit"] == "rad"


def test_every_description_gives_the_rotation_back() -> None:
    first = rotation(quaternion=(0.5, -0.1, 0.7, 0.5)).to_dict()
    R = np.array(first["matrix"])
    again = [{"matrix": tuple(R.ravel().tolist())}, {"quaternion": tuple(first["quaternion"])}]
    again += [{"axis": tuple(first["axis"]), "angle": first["angle"]}]
    again += [{"axis": tuple(-np.array(first["axis"])), "angle": -first["angle"]}]
    for order, each in first["orders"].items():
        for angles in each["solutions"]:
            again += [{"angles": tuple(angles), "order": order}]
            again += [{"angles": tuple(angles[::-1]), "order": order[::-1], "fixed": True}]
    for options in again:
        given = {name: tuple(map(float, v)) if isinstance(v, tuple) else v for name, v in options.items()}
        np.testing.assert_allclose(rotation(**given).to_dict()["matrix"], R, rtol=0, atol=1e-7)


def test_singular_cases_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["kinematics", "--angles", "30,90,10"]) == 0
    seen = capsys.readouterr().out
    assert "c − a alone is determined" in seen
    assert rotation(angles=(30, 90, 10)).to_dict()["orders"]["zyx"]["solutions"] == [[0, 90, -20]]
    half = rotation(axis=(0.0, 0.0, 2.0), angle=180.0)
    assert half.to_dict()["both_axes"] and "half a turn" in half.summary()
    still = rotation(angles=(0, 0, 0))
    assert still.to_dict()["axis"] is None and "any axis will do" in still.summary()
    assert still.to_dict()["orders"]["zxz"]["determined"] == "c + a"


def test_a_printed_matrix_is_mended_and_others_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = rotation(matrix=(0.866, -0.5, 0, 0.5, 0.866, 0, 0, 0, 1))
    assert found.warnings and found.to_dict()["angle"] == pytest.approx(30, abs=0.01)
    for options, message in (
        ({"matrix": (1, 0, 0, 0, 1, 0, 0, 0, -1)}, "as of a reflection"),
        ({"matrix": (1, 0, 0, 0, 1, 0, 0, 0.1, 1)}, "RᵀR misses 1 by 0.1"),
        ({"matrix": (1, 0, 0)}, "has 3 numbers, not 9"),
        ({"quaternion": (1, 0, 0, 1)}, "its norm is 1.41421"),
        ({"axis": (0, 0, 0), "angle": 3.0}, "give a direction that is not zero"),
        ({"axis": (0, 0, 1)}, "belong together"),
        ({"quaternion": (1, 0, 0, 0), "order": "zxz"}, "say what --angles mean"),
        ({"quaternion": (1, 0, 0, 0), "angles": (1, 2, 3)}, "each give a rotation"),
        ({"angle": 30.0}, "belong together"),
        ({"radians": True}, "give one of matrix"),
        ({"angles": (1, 2, 3), "joints": (1, 2)}, "joints changes nothing here"),
        ({"angles": (float("nan"), 0, 0)}, "give finite numbers"),
    ):
        with pytest.raises(LabError, match=message):
            rotation(**{n: tuple(map(float, v)) if isinstance(v, tuple) else v for n, v in options.items()})  # type: ignore[attr-defined]
    assert main(["kinematics", "--angles", "1,2,3", "--joints", "1,2"]) == 2
    assert "--joints is of a robot" in capsys.readouterr().err
    assert main(["kinematics", "--angles", "1,2,3", "--json", "--out", str(tmp_path / "out")]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert json.loads((tmp_path / "out" / "result.json").read_text()) == printed
    assert list(rotation(angles=(1.0, 2.0, 3.0)).columns()) == ["order", "a_deg", "b_deg", "c_deg"]
