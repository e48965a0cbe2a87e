"""Robust designs are judged on arms that they did not see: more poses and better poses predict less error."""

import numpy as np
import pytest
import robust_design_study as study

from lab.campaign.design_problem import pose_problem
from lab.campaign.options import DesignOptions
from lab.pose_selection.criteria import predict
from lab.pose_selection.exchange import information


@pytest.mark.thorough
def test_designs_beat_random_poses_and_compliance_has_to_be_designed_for() -> None:
    options = study.Options(arms=3, worst_of=1, poses=11, candidates=40, sets=3)
    rows = {row["poses_by"]: row for row in study.answer(options).values["rows"]}
    random, rigid, compliant, worst = rows.values()
    assert worst["worst_mm"] < rigid["worst_mm"] < random["worst_mm"] and compliant["worst_mm"] < rigid["worst_mm"]
    assert rigid["loaded"] == 0 and worst["loaded"] > 0
    for row in rows.values():
        assert 0 < row["mean_mm"] <= row["worst_mm"] < row["worst_pose_mm"]


def test_the_judgement_is_the_predicted_error_of_each_perturbed_arm() -> None:
    judge = pose_problem(
        DesignOptions(model=study.COMPLIANT, criterion="I", payload_kg=(0.0, 3.0), worst_of=2, candidates=15, seed=5)
    )
    inputs = judge.inputs
    found = study.judged(judge, inputs)
    rms = [
        predict(information(case.whitened(inputs)), case.test, np.random.default_rng(0)).rms for case in judge.cases[1:]
    ]
    assert found["worst_mm"] == pytest.approx(1e3 * max(np.sqrt((each**2).mean()) for each in rms), rel=1e-6)
    assert found["worst_pose_mm"] == pytest.approx(1e3 * max(each.max() for each in rms), rel=1e-6)
    assert found["loaded"] == 15
    assert study.judged(judge, inputs[:20])["worst_mm"] > found["worst_mm"]
    assert study.judged(judge, inputs[:3])["worst_mm"] == np.inf
