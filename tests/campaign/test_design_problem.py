"""A design's problem: candidates and sensitivities, and the search among them."""

import numpy as np
import pytest

from lab.campaign.design_problem import best_design, pose_problem
from lab.campaign.options import DesignOptions
from lab.pose_selection.exchange import information

OPTIONS = DesignOptions(candidates=120, starts=1, poses=12)


@pytest.mark.thorough
def test_the_pool_is_the_sensitivity_of_the_candidates_and_a_design_beats_the_first_of_them() -> None:
    problem = pose_problem(OPTIONS)
    joints = problem.candidates.joints
    assert problem.pool.shape == (120, 3, 27) and problem.test.shape[1:] == (3, 27)
    np.testing.assert_allclose(problem.pool[:10], problem.sensitivity(joints[:10]), rtol=1e-12)
    assert problem.access.feasible(joints).all() and problem.measured is None
    stages: list[tuple[str, int, int]] = []
    design = best_design(OPTIONS, problem, 12, lambda words, done=0, of=0: stages.append((words, done, of)))
    assert stages == [("2 of 5, design of 12 poses, start 1 of 1", 0, 1)]
    assert problem.access.feasible(design.joints).all()
    assert design.score > float(problem.goal.score(information(problem.pool[:12])))
