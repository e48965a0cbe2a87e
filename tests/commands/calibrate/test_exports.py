"""The files of the arm in a run: which effects each has, which it lacks, and what it says of that."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.campaigns import run_of, session
from helpers.estimates import nominal_estimate, with_values

import lab
from lab.formats.calibrated_module import loaded
from lab.library.arm_files import comment_on_missing_effects
from lab.robots.load_robot import load_virtual


def test_a_file_of_geometry_says_what_it_lacks() -> None:
    nominal = nominal_estimate(load_virtual("irb120"), ("p1", "p2"), ("gear",))
    arm, values = nominal.arm, nominal.values.copy()
    inputs = arm.rigid.chain.random_joints(50, np.random.default_rng(0))
    values[-6:] = 1e-4
    off = with_values(nominal, values).geometry_error(inputs)
    alone = arm.rigid.points(inputs, values[:-6])
    by_hand = np.linalg.norm(arm.points(inputs, values) - alone, axis=2)
    assert off == pytest.approx(np.sqrt((by_hand**2).mean())) and off > 1e-5
    said = comment_on_missing_effects(arm.groups, off, "at the measured poses", module=True)
    assert "gear" in said and f"{1e3 * off:.2g} mm" in said
    bare = nominal_estimate(load_virtual("irb120"), ("p1", "p2"), ())
    assert comment_on_missing_effects((), bare.geometry_error(inputs), "there", module=True) == ""


@pytest.mark.thorough
def test_a_bad_run_is_written_without_the_files_that_cannot_hold_its_arm(tmp_path: Path) -> None:
    """Of points that are mirrored."""
    data = session("ur5", poses=40, seed=1).measurements
    result = lab.identify(replace(data, points=data.points[..., [1, 0, 2]]), noise_mm=0.01, holdout=0.3)
    result.save(tmp_path / "run")
    found = json.loads((tmp_path / "run" / "result.json").read_text())
    assert found["verdict"] == "bad" and (tmp_path / "run" / "calibrated.toml").is_file()
    left_out = [name for name in ("ur_kinematics.yaml", "calibration.conf") if not (tmp_path / "run" / name).exists()]
    assert left_out
    for name in left_out:
        assert found["exports"][name]["has"] == [] and "apart" in found["exports"][name]["reason"]
        assert any(text.startswith(f"{name} is not written") for text in found["warnings"])
    estimate = result.estimate
    row = result.measurements[[0]]
    free = np.full((1, 3, 3), np.nan)
    targets = lab.Targets("p1", ("a",), estimate.arm.points(row.joints, estimate.values)[:, 0], free, row.joints, {})
    corrected = lab.compensate(targets, run=result, force=True, no_check=True)  # on request it is built on, too
    corrected.save(tmp_path / "corrected")
    assert (tmp_path / "corrected" / "calibrated.urdf").is_file()
    assert any(text.startswith(f"{left_out[0]} is not written") for text in corrected.warnings)


@pytest.mark.thorough
def test_an_arm_that_bends_has_its_kinematics_for_ros(tmp_path: Path) -> None:
    """Of Universal Robots: not one of the files is missing, and each says what it lacks."""
    soft = {"stiffness_nm_per_rad": 1e5, "payload_kg": (0.0, 3.0), "model": "compliance"}
    result = lab.calibrate("ur10", poses=20, seed=2, **soft)
    result.save(tmp_path / "run")
    row = result.measurements[[0]]
    free = np.full((1, 3, 3), np.nan)
    targets = lab.Targets("p1", ("a",), row.points[:, 0], free, row.joints, row.conditions)
    lab.compensate(targets, run=result, force=True, no_check=True).save(tmp_path / "corrected")
    exports = json.loads((tmp_path / "run" / "result.json").read_text())["exports"]
    for name in ("calibrated.toml", "ur_kinematics.yaml", "calibration.conf"):
        assert exports[name]["lacks"] == ["compliance"] and exports[name]["off_mm"] > 0.1
    assert set(yaml.safe_load((tmp_path / "run" / "ur_kinematics.yaml").read_text())["kinematics"]) >= {"wrist_3"}
    assert exports["calibrated.py"] == {
        "has": ["geometric", "compliance"], "lacks": [], "conditions": ["payload_kg"], "reason": None
    }  # fmt: skip
    module = loaded((tmp_path / "corrected" / "calibrated.py").read_text(encoding="utf-8"))
    _, points = module.forward(row.joints[0].tolist(), payload_kg=float(row.conditions["payload_kg"][0]))
    assert np.linalg.norm(np.array(points["p1"]) - row.points[0, 0]) < 2e-4


@pytest.mark.thorough
def test_a_mechanism_has_a_module_that_refuses() -> None:
    run = run_of("delta", poses=20, seed=1)
    said = json.loads((run / "result.json").read_text())["exports"]["calibrated.py"]
    assert said["has"] == [] and said["lacks"] == ["geometric"] and "loops" in said["reason"]
    module = loaded((run / "calibrated.py").read_text(encoding="utf-8"))
    with pytest.raises(NotImplementedError, match="loops"):
        module.forward([0.0, 0.0, 0.0])
