"""Recordings of verifications and of corrected targets."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.recordings import column, rrd, statics

from lab.library.compensate import compensate
from lab.library.load_run import load_run
from lab.library.verify import verify
from lab.report.views.error_recording import record_compensation, record_verification

pytestmark = [pytest.mark.usefixtures("strict_recordings"), pytest.mark.figures]

VECTORS = "Arrows3D:vectors"


def factor_of(path: Path, entity: str) -> float:
    """The magnification that the arrows' label says."""
    said = statics(path, entity, "Points3D:labels")[0]
    return float(said.split("×")[1].replace(",", ""))


def test_a_verification_shows_measured_less_predicted(seven_run: Path, seven, tmp_path: Path, home) -> None:
    """To scale and in the world: arrows of an arm that was moved are longer than the sphere of what is expected."""
    points = seven.measurements.points + np.array([2e-4, 0, 0])
    result = verify(str(seven_run), replace(seven.measurements, points=points)[:6])
    path = tmp_path / "recording.rrd"
    record_verification(path, result)
    assert rrd(home, "verify", path).returncode == 0
    factor = factor_of(path, "/world/errors/observed/factor")
    rows, vectors = column(path, "/world/errors/observed", VECTORS)
    lengths = np.linalg.norm(np.array(vectors), axis=2)
    assert rows == list(range(6))
    np.testing.assert_allclose(lengths / factor, result.verified.errors, rtol=1e-4)
    radius = np.array(column(path, "/world/magnified/expected", "Ellipsoids3D:half_sizes")[1])
    np.testing.assert_allclose(
        radius / factor_of(path, "/world/magnified/expected/factor"), result.verified.expected_m, rtol=1e-4
    )
    assert len(column(path, "/world/arm/link3", "Transform3D:translation", "time")[0]) > 6


def test_corrected_targets_show_what_the_arm_would_miss(seven_run: Path, tmp_path: Path) -> None:
    """Waypoints that are only passed have no target; the arrows are what the nominal model's joints would miss."""
    calibrated = load_run(seven_run)
    arm, values = calibrated.estimate.geometry
    points = 1e3 * arm.points(0.6 * arm.chain.random_joints(6, np.random.default_rng(1)), values)[:, 0]
    file = tmp_path / "targets.csv"
    file.write_text("p1_x_mm,p1_y_mm,p1_z_mm\n" + "".join("{},{},{}\n".format(*row) for row in points.tolist()))
    result = compensate(file, run=str(seven_run))
    path = tmp_path / "recording.rrd"
    record_compensation(path, result)
    at_targets = np.flatnonzero(result.waypoints.which >= 0).tolist()
    rows, vectors = column(path, "/world/errors/uncorrected", VECTORS)
    shown = [(row, value) for row, value in zip(rows, vectors, strict=True) if value]
    factor = factor_of(path, "/world/errors/uncorrected/factor")
    lengths = np.linalg.norm([value[0] for _, value in shown], axis=1) / factor
    assert [row for row, _ in shown] == at_targets and len(rows) == len(result.waypoints.joints)
    aimed = result.reached[result.waypoints.which[at_targets]]
    missed = arm.points(result.found.uncorrected, values)[:, 0] - result.wanted.positions
    np.testing.assert_allclose(lengths, np.linalg.norm(missed, axis=1)[aimed], rtol=1e-4)
    np.testing.assert_allclose(lengths, result.correction_m[aimed], rtol=0.05)  # as far as the targets are moved
    logs = np.array(column(path, "/error_log10_mm/expected", "Scalars:scalars")[1])[:, 0]
    np.testing.assert_allclose(logs, np.log10(1e3 * result.predicted_m[aimed]), rtol=1e-9)
