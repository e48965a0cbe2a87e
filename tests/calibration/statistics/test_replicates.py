"""Which rows repeat one another."""

from dataclasses import replace

import numpy as np

from lab.calibration.statistics.goodness_of_fit import repeats
from lab.core.measurements import measured

JOINTS = np.array([[0.1, 0.2], [0.3, 0.2], [0.1, 0.2], [0.1, 0.2]])


def data():
    return measured(("a", "b"), JOINTS, ("p1",), np.random.default_rng(0).normal(size=(4, 1, 3)))


def groups(labels: np.ndarray) -> set[tuple[int, ...]]:
    return {tuple(np.flatnonzero(labels == label).tolist()) for label in set(labels.tolist())}


def test_rows_with_the_same_joint_positions_are_repeats() -> None:
    assert groups(repeats(data())) == {(0, 2, 3), (1,)}


def test_a_payload_an_approach_and_a_session_part_them_and_the_time_does_not() -> None:
    last = np.array([0.0, 0.0, 0.0, 1.0])
    for name in ("payload_kg", "approach_a"):
        assert groups(repeats(replace(data(), conditions={name: last}))) == {(0, 2), (1,), (3,)}
    assert groups(repeats(replace(data(), conditions={"time_s": last}))) == {(0, 2, 3), (1,)}
    assert groups(repeats(replace(data(), sessions=("", "", "", "later")))) == {(0, 2), (1,), (3,)}
