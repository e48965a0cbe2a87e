"""How much of the elastic error geometry absorbs: the larger the workspace and the more payloads, the less."""

import elastic_error_absorbed
import numpy as np
import pytest
from helpers.run_script import answer_of

from lab.robots.load_robot import load_robot


@pytest.mark.thorough
def test_geometry_absorbs_little_of_the_elastic_error() -> None:
    rows = answer_of("elastic_error_absorbed.py", "--poses", 60, "--pool", 30000)["rows"]
    share = {(row["cause"], row["edge_m"], row["payload"]): row["share"] for row in rows}
    for cause in elastic_error_absorbed.CAUSES:
        assert 0.3 < share[cause, 0.2, "no payload"] < 0.8  # a small cube and one payload
        assert share[cause, None, "0 or 3 kg"] < 0.2
        assert share[cause, None, "no payload"] < share[cause, 0.4, "no payload"] < share[cause, 0.2, "no payload"]
        assert share[cause, 0.2, "measured empty, 3 kg at work"] < 0.2
    for row in rows:
        assert row["poses"] == 60 and row["elastic_mm"] > row["aligned_mm"] > 0


def test_a_rigid_error_is_absorbed_whole(monkeypatch) -> None:
    """An error that is geometry's own: nothing is left of it."""
    robot = load_robot("irb120")
    joints = robot.chain.random_joints(80, np.random.default_rng(0))
    monkeypatch.setattr(elastic_error_absorbed, "CAUSES", {"a link too long": {"link2.a": 0.2701}})
    found = elastic_error_absorbed.absorbed(robot, joints, "a link too long", "no payload")
    assert found["aligned_mm"] > 0.01 and found["share"] == pytest.approx(1.0, abs=1e-3)
