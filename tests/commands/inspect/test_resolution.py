"""Resolution at the tool: distances from the axes, a coupled drive, a slide and a mechanism, and what is not given."""

import json
from pathlib import Path

import numpy as np
import pytest

import lab
from lab.cli.main import main
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.units import MM
from lab.library.joint_resolution import encoders_of

ARC = 2 * np.pi / 4096 / 50  # rad of a joint by one count


def by_count(found: dict, joint: str) -> tuple[float, float, float]:
    each = next(each for each in found["encoders"] if each["joint"] == joint)
    return each["min_mm"], each["mean_mm"], each["max_mm"]


def test_one_count_moves_the_tool_by_its_distance_from_the_axis() -> None:
    """The course's arm of 1 m: q1 by L cos q2, q2 by L, in steps of a thousandth and a hundredth of a degree."""
    found = lab.inspect("course2r", joint_steps=(0.001, 0.01)).to_dict()["resolution"]
    chain = lab.load_robot("course2r").chain
    lever = 1e3 * np.cos(chain.random_joints(found["poses"], rng_for(0, "structure"))[:, 1])
    step = np.deg2rad(0.001)
    np.testing.assert_allclose(by_count(found, "q1"), step * np.array([lever.min(), lever.mean(), lever.max()]))
    np.testing.assert_allclose(by_count(found, "q2"), 3 * [10 * step * 1e3])
    assert found["coarsest_encoder"] == "q2" and found["step_max_mm"] == pytest.approx(10 * step * 1e3)
    expected = np.sqrt((step * lever) ** 2 + (10 * step * 1e3) ** 2) / np.sqrt(12)
    assert found["rounding_mean_mm"] == pytest.approx(expected.mean())


def test_a_coupled_drive_turns_two_joints_by_a_count(tmp_path: Path) -> None:
    """Motor 2 turns by G (q2 + q1): a count of motor 1 turns q1 on and q2 back, so that the second link only shifts."""
    table = "name = 'two'\nconvention = 'distal'\n"
    table += 2 * "[[joint]]\ntheta_deg = 0\nd_mm = 0\na_mm = 300\nalpha_deg = 0\nlower_deg = -170\nupper_deg = 170\n"
    table += 2 * "[[drive]]\ngear_ratio = 50\ncounts_per_turn = 4096\n"
    (tmp_path / "two.toml").write_text(table + "[[coupling]]\ndrive = 2\njoint = 1\nratio = 50\n")
    (tmp_path / "free.toml").write_text(table)
    coupled, free = (
        lab.inspect(tmp_path / name, tool_mm=(0, 0, 0)).to_dict()["resolution"] for name in ("two.toml", "free.toml")
    )
    np.testing.assert_allclose(by_count(coupled, "q1"), 3 * [ARC * 300], rtol=1e-9)
    np.testing.assert_allclose(by_count(coupled, "q2"), 3 * [ARC * 300], rtol=1e-9)
    assert by_count(free, "q1")[2] > 1.9 * ARC * 300
    q = lab.load_robot(tmp_path / "free.toml").chain.random_joints(500, rng_for(0, "structure"))
    reach = 300 * np.abs(1 + np.exp(1j * q[:, 1]))
    assert by_count(free, "q1")[1] == pytest.approx(ARC * reach.mean())


@pytest.mark.thorough
def test_slides_and_mechanisms_have_theirs(capsys) -> None:
    assert main(["inspect", "scara", "--joint-steps", "0.001,0.001,0.002,0.001", "--json"]) == 0
    np.testing.assert_allclose(by_count(json.loads(capsys.readouterr().out)["resolution"], "q3"), 3 * [0.002])
    found = lab.inspect("delta", joint_steps=(0.01,)).to_dict()["resolution"]
    robot = lab.load_robot("delta")  # by differences of the closed loops
    arm = robot.arm(("p1",))
    values, joints = arm.nominal(robot.tool), robot.chain.random_joints(500, rng_for(0, "structure"))[:40]
    step = np.deg2rad(0.01) * np.array([1.0, 0, 0])
    moved = arm.tool(joints + step / 2, values)[0] - arm.tool(joints - step / 2, values)[0]
    lengths = MM.of(np.linalg.norm(moved[:, :3, 3], axis=1))
    least, _, most = by_count(found, "theta1")
    assert least <= lengths.min() * (1 + 1e-5) and lengths.max() <= most * (1 + 1e-5)


def test_unknown_encoders_are_not_given() -> None:
    assert lab.inspect("tx40").to_dict()["resolution"] is None
    chain = lab.load_robot("tx40").chain
    assert encoders_of(chain, ()) is None
    for steps in ((1.0, 2.0), (0.0,), (-1.0,), (float("nan"),)):
        with pytest.raises(LabError, match="--joint-steps"):
            encoders_of(chain, steps)
