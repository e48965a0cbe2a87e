"""A design's problem: candidates and sensitivities, and the search among them."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.bad_input import ARM_XML

from lab.core.errors import LabError
from lab.options.virtual_campaign import DesignOptions
from lab.planning.design_problem import pose_problem
from lab.planning.design_search import best_design
from lab.pose_selection.exchange import information


def small(tmp_path: Path, **options: Any) -> DesignOptions:
    """Options of a design for an arm of three joints with masses."""
    (tmp_path / "arm.xml").write_text(ARM_XML)
    return DesignOptions(str(tmp_path / "arm.xml"), candidates=60, starts=1, **options)


def test_a_pose_carries_one_of_the_payloads_and_its_sensitivity_is_the_loaded_arm_s(tmp_path: Path) -> None:
    problem = pose_problem(small(tmp_path, model="geometric+compliance", payload_kg=(0.0, 2.0, 5.0)))
    assert problem.inputs.shape == (180, 4) and problem.pool.shape[0] == 180
    np.testing.assert_array_equal(problem.payload(problem.inputs), np.repeat([0.0, 2.0, 5.0], 60))
    arm = problem.robot.arm_with(("p1",), ["compliance"])
    values = np.concatenate([problem.values, np.zeros(len(arm.names) - len(problem.values))])
    column = arm.names.index("joint2.compliance")
    own = list(problem.structure.identifiable).index(column)
    slope = arm.observe(problem.inputs, values)[1][:, 0, :, column]
    ratio = np.linalg.norm(problem.whitened(problem.inputs)[..., own], axis=1) / np.linalg.norm(slope, axis=1)
    np.testing.assert_allclose(ratio, np.sqrt(3) / 8e-6, rtol=1e-6)  # 8 µm in space
    lighter, heavier = (np.linalg.norm(problem.pool[rows][..., own], axis=1) for rows in (slice(60), slice(120, 180)))
    assert (heavier > lighter).mean() > 0.9
    between = problem.inputs[:1] + np.array([0, 0, 0, 0.7])  # a step of the ascent: the nearest payload counts
    np.testing.assert_array_equal(problem.whitened(between), problem.whitened(problem.inputs[:1]))
    kept = pickle.dumps(problem)
    again = pickle.loads(kept)
    np.testing.assert_array_equal(again.pool, problem.pool)
    assert len(pickle.dumps(replace(problem, pool=np.zeros(10**6)))) == len(kept), "the pool is not pickled"


def test_a_design_for_compliance_loads_poses_and_one_for_geometry_has_no_reason_to(tmp_path: Path) -> None:
    options = small(tmp_path, model="geometric+compliance", payload_kg=(0.0, 5.0), poses=10)
    problem = pose_problem(options)
    design = best_design(options, problem, 10)
    carried = problem.payload(design.joints)
    assert set(carried.tolist()) <= {0.0, 5.0} and (carried == 5.0).any()
    empty = pose_problem(replace(options, payload_kg=()))
    assert empty.inputs.shape == (60, 3)
    alone = best_design(options, empty, 10)
    both = problem.goal.score(information(design.jacobian))
    assert both > problem.goal.score(information(problem.sensitivity(np.column_stack([alone.joints, np.zeros(10)]))))


def test_the_error_is_predicted_at_the_targets_of_a_file(tmp_path: Path) -> None:
    everywhere = pose_problem(small(tmp_path))
    arm, values = everywhere.arm, everywhere.values
    wanted = arm.points(everywhere.candidates.joints[[3, 17, 29]], values)[:, 0]
    rows = [",".join(f"{1e3 * x:.6f}" for x in point) for point in wanted]
    (tmp_path / "task.csv").write_text("\n".join(["x_mm,y_mm,z_mm", *rows]) + "\n")
    task = pose_problem(small(tmp_path, region=str(tmp_path / "task.csv"), criterion="I"))
    base = [i for i, name in enumerate(arm.names) if name in ("base.rx", "base.ry", "base.rz")]
    assert len(task.test) % 3 == 0 and len(task.test) >= 3 and len(everywhere.test) == 500
    at = [list(task.structure.identifiable).index(i) for i in base]
    turned = task.test[..., at]  # by the base's rotation: what a point's distance from the base gives
    expected = arm.observe(everywhere.candidates.joints[[3, 17, 29]], values)[1][:, 0][..., base]
    for one in turned:
        assert np.abs(one - expected).max(axis=(1, 2)).min() < 1e-5
    box = pose_problem(small(tmp_path, region="200,500,-200,200,100,500"))
    assert 0 < len(box.test) <= 800


def test_a_region_s_design_predicts_less_error_there_than_one_for_everywhere(tmp_path: Path) -> None:
    task = small(tmp_path, region="300,500,-100,100,200,400", criterion="I", poses=8)
    problem = pose_problem(task)
    everywhere = best_design(replace(task, region="workspace"), pose_problem(replace(task, region="workspace")), 8)
    there = best_design(task, problem, 8)
    assert there.score > float(problem.goal.score(information(problem.sensitivity(everywhere.joints))))


def test_joint_positions_of_the_file_choose_the_configuration(tmp_path: Path) -> None:
    problem = pose_problem(small(tmp_path))
    joints = problem.candidates.joints[7]
    point = problem.arm.points(joints[None], problem.values)[0, 0]
    cells = [*(f"{1e3 * x:.6f}" for x in point), *(f"{np.rad2deg(x):.8f}" for x in joints)]
    (tmp_path / "task.csv").write_text(f"x_mm,y_mm,z_mm,q1_deg,q2_deg,q3_deg\n{','.join(cells)}\n")
    task = pose_problem(small(tmp_path, region=str(tmp_path / "task.csv")))
    expected = problem.arm.observe(joints[None], problem.values)[1][0, 0][:, list(problem.structure.identifiable)]
    np.testing.assert_allclose(task.test, expected[None], atol=1e-6)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"model": "geometric+drift"}, ("--model geometric+drift", "time_s")),
        ({"model": "auto"}, ("--model auto", "by name")),
        ({"model": "geometric+nothing"}, ("nothing",)),
        ({"model": "geometric,compliance"}, ("geometric,compliance",)),
        ({"payload_kg": (0.0, 2.0)}, ("--payload-kg", "compliance")),
        ({"payload_kg": (2.0, 2.0), "model": "compliance"}, ("--payload-kg", "once")),
        ({"payload_kg": (-1.0,), "model": "compliance"}, ("--payload-kg -1",)),
        ({"region": "measured"}, ("--region measured",)),
        ({"region": "5000,5100,0,100,0,100"}, ("--region", "reaches none")),
        ({"region": "none.csv"}, ("none.csv",)),
    ],
)
def test_what_makes_no_sense_is_refused(tmp_path: Path, options: dict[str, Any], words: tuple[str, ...]) -> None:
    requested = small(tmp_path, **options)
    with pytest.raises(LabError) as refusal:
        requested.refuse_nonsense()
        pose_problem(requested)
    assert all(word in str(refusal.value) for word in words), str(refusal.value)
