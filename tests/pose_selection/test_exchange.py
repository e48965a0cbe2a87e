"""The exchange's bookkeeping, and the candidates that an arm cannot go to."""

from itertools import combinations

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.pose_selection.criteria import criterion
from lab.pose_selection.exchange import exchange, information


def pool(size: int = 60, p: int = 6, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(size, 2)), rng.normal(size=(size, 3, p)) * np.geomspace(1, 30, p)


@pytest.mark.parametrize("count", [2, 3, 7])
def test_no_exchange_of_one_pose_is_better(count: int) -> None:
    """Each place of the design found, tried with every other candidate by whole determinants; also where a design
    one pose short is singular (two poses of three rows, six columns)."""
    joints, jacobian = pool()
    found = exchange(joints, jacobian, count, criterion("O1", 6), np.random.default_rng(1), starts=1)
    assert found.score == pytest.approx(np.linalg.slogdet(information(found.jacobian))[1], rel=1e-9)
    for slot in range(count):
        others = [row for row in range(len(joints)) if row not in found.rows]
        for row in others:
            rows = [*np.delete(found.rows, slot), row]
            assert np.linalg.slogdet(information(jacobian[rows]))[1] <= found.score + 1e-8


@pytest.mark.parametrize("name", ["O1", "A", "O2"])
def test_what_cannot_be_reached_is_not_chosen_and_the_rest_as_well_as_without_it(name: str) -> None:
    joints, jacobian = pool(11)
    near = joints[:, 0] < np.sort(joints[:, 0])[8]
    goal = criterion(name, 6)
    asked: list[int] = []

    def reachable(poses: np.ndarray) -> np.ndarray:
        asked.append(len(poses))
        return near[[int(np.flatnonzero((joints == pose).all(axis=1))[0]) for pose in poses]]

    found = exchange(joints, jacobian, 3, goal, np.random.default_rng(0), starts=6, reachable=reachable)
    assert near[found.rows].all() and not near.all() and asked
    best = max(
        float(goal.score(information(jacobian[list(c)]))) for c in combinations(np.flatnonzero(near).tolist(), 3)
    )
    assert found.score == pytest.approx(best)


def test_too_few_that_can_be_reached_are_told() -> None:
    joints, jacobian = pool(20)
    rng = np.random.default_rng(0)
    with pytest.raises(LabError, match="no free way leads to 4 of 20 candidates"):
        exchange(joints, jacobian, 4, criterion("O1", 6), rng, reachable=lambda poses: poses[:, 0] > joints[3, 0] + 9)
