"""What a certificate takes for chance, from a run whose noise is not the same in all directions."""

from pathlib import Path

import numpy as np
import pytest
from helpers.robots import IRB120

import lab
from lab.calibration.gauss_newton import Observations
from lab.core.linear_model import whitening
from lab.core.measurements import measured
from lab.library.certificate_inputs import FittedRows, _scatter_m
from lab.library.certify import certify
from lab.noise.correlation import Correlation
from lab.noise.instruments import instrument
from lab.options.command_options import CertifyOptions

TRACKERS = ("leica-at960", "faro-vantage")
NOISE = """
[noise]
radial_um = 0
radial_um_per_m = 0.25
transverse_um = 7.5
transverse_um_per_m = 3
"""


@pytest.mark.parametrize("name", ["leica-at960", "uniform-8um"])
def test_scatter_is_that_of_the_points_whatever_they_are_weighed_by(name: str) -> None:
    """Joints that move points by 20 µm in each direction: kept as rows in units of a noise of 6 to 15 µm."""
    rng = np.random.default_rng(0)
    points = np.array([2.0, -1.5, 0.5]) + 0.3 * rng.normal(size=(40, 2, 3))
    points[5, 1] = np.nan
    covariance = instrument(name).covariance(np.nan_to_num(points, nan=1.0))
    alone = Observations(np.zeros((40, 6)), points, whitening(covariance))
    moved = 20e-6 / np.sqrt(6) * np.sign(rng.normal(size=(40, 2, 3, 6)))  # of each of six joints
    rows = np.where(alone.seen[..., None, None], alone.in_units_of_noise(moved), 0.0).reshape(40, 6, 6)
    none = np.zeros((40, 6, 0))
    observed = Observations(alone.inputs, points, alone.whiten, Correlation(rows, none, 0.0, none, np.arange(40.0)))
    data = measured(IRB120.chain.joint_names, observed.inputs, ("p1", "p2"), points)
    fitted = FittedRows(data, None, observed, 12e-6, instrument(name))
    assert _scatter_m(fitted) == pytest.approx(20e-6, rel=1e-9)


@pytest.mark.thorough
def test_an_error_of_the_nest_is_no_repeatability_of_the_robot(tmp_path: Path) -> None:
    """3 µm of nest: the preset has them; a file with a range of 0.7 µm and no nest must not make 0.3 mm of them."""
    (tmp_path / "real.toml").write_text(NOISE + "[systematic]\nnest_um = { standard = 3 }\n")
    (tmp_path / "stated.toml").write_text(NOISE)
    targets = ("p1", "p2", "p3")
    day = lab.simulate("irb120", poses=60, seed=1, instrument=tmp_path / "real.toml", targets=targets)
    found = {}
    for name in ("leica-at960", str(tmp_path / "stated.toml")):
        result = lab.identify(day.measurements, robot="irb120", instrument=name, validate=day.validation)
        run = result.save(tmp_path / Path(name).stem)
        budget = certify(CertifyOptions(run, force=True)).budgets[0]
        lines = {line.quantity.group: line.quantity.uncertainty.standard for line in budget.lines}
        found[name] = lines.get("repeatability", 0.0), budget.expanded_m
    assert found["leica-at960"][0] == 0.0 and found["leica-at960"][1] < 0.02e-3
    repeatability, expanded = found[str(tmp_path / "stated.toml")]
    assert 5e-6 < repeatability < 40e-6 and expanded < 0.15e-3  # 0.05 mrad of joints 0.5 m away, as the run says


@pytest.mark.thorough
def test_one_session_is_worth_the_same_whichever_tracker_is_named(tmp_path: Path) -> None:
    """Mean errors within 20 %; the nominal model's alike; U grows as the stated noise does."""
    targets = ("p1", "p2", "p3")
    day = lab.simulate("irb120", poses=50, seed=2, instrument="leica-at960", targets=targets)
    before, after, expanded = [], [], []
    for name in TRACKERS:
        result = lab.identify(day.measurements, robot="irb120", instrument=name, validate=day.validation)
        told = result.to_dict()
        before.append(told["before_mm"]["mean"])
        after.append(told["after_mm"]["mean"])
        budget = certify(CertifyOptions(result.save(tmp_path / name), force=True)).budgets[0]
        assert {line.quantity.group for line in budget.lines} <= {"parameters", "misalignment", "reflector"}
        expanded.append(budget.expanded_m)
    np.testing.assert_allclose(before, before[0], rtol=1e-9)
    assert max(after) < 1.2 * min(after)
    points = day.measurements.points.reshape(-1, 3)
    best = whitening(instrument(TRACKERS[0]).covariance(points))
    for name, each in zip(TRACKERS[1:], expanded[1:], strict=True):
        ratios = np.sqrt(np.linalg.eigvalsh(best @ instrument(name).covariance(points) @ np.swapaxes(best, 1, 2)))
        assert 0.98 * ratios.min() < each / expanded[0] < 1.02 * ratios.max()  # what was drawn has two digits
