"""Languages of controllers: what one has to offer is all that the commands ask of it."""

import numpy as np
import pytest

from lab.extensions.programs.rapid import Rapid
from lab.formats.programs import languages as registry
from lab.formats.programs.protocol import MeasuringTour, TargetMoves
from lab.kinematics.joints import JointSpec


class Spoken:
    """A language for robots of two joints."""

    name = "Spoken"
    suffix = ".txt"
    makers = ("talker",)
    speed = "slowly"

    def refusal(self, joints: JointSpec) -> str | None:
        return None if joints.size == 2 else f"no spoken program for {joints.size} joints"

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        return f"{tour.robot}: {len(tour.waypoints)} stops, {', '.join(tour.ids)}".encode()

    def target_moves(self, moves: TargetMoves) -> bytes:
        return f"{moves.robot}: {', '.join(moves.ids)}".encode()


def joints(count: int) -> JointSpec:
    every = np.ones(count)
    return JointSpec(
        name="arm",
        joint_names=tuple(f"q{i}" for i in range(count)),
        prismatic=(False,) * count,
        sign=every,
        lower=-every,
        upper=every,
        speed=every,
        acceleration=every,
    )


@pytest.fixture(autouse=True)
def two_languages(monkeypatch: pytest.MonkeyPatch) -> None:
    known = (Rapid(), Spoken())
    monkeypatch.setattr(registry, "languages", lambda: known)


def test_the_chosen_language_writes_for_the_robots_that_it_can_move() -> None:
    tour = MeasuringTour("arm", np.zeros((4, 2)), np.array([-1, 0, 1, -1]), ("3", "4"))
    assert registry.plan_files(joints(2), "spoken", tour) == {"plan.txt": b"arm: 4 stops, 3, 4"}
    moves = TargetMoves("arm", ("a", "b"), np.zeros((2, 2)), np.arange(2), np.eye(4), np.eye(4))
    assert registry.target_files(joints(2), "spoken", moves) == {"program.txt": b"arm: a, b"}
    six = TargetMoves("arm", ("a",), np.zeros((1, 6)), np.arange(1), np.eye(4), np.eye(4))
    assert list(registry.target_files(joints(6), "rapid", six)) == ["program.mod"]
    assert registry.target_files(joints(6), "spoken", six) == registry.target_files(joints(6), None, six) == {}


def test_a_result_says_of_each_language_the_file_or_the_reason() -> None:
    said = registry.plan_or_refusal(joints(6), "rapid")
    assert said == {"rapid": "plan.mod", "spoken": "no program in it: RAPID is the controller's language"}
    assert registry.plan_or_refusal(joints(6), "spoken")["spoken"] == "no spoken program for 6 joints"
    assert registry.refusal(joints(6), "spoken") == "no spoken program for 6 joints"
    assert registry.refusal(joints(2), "spoken") is None
