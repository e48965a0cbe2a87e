"""Test new measurements against a calibrated arm: is it within its predicted error?"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.statistics.outliers import LEAST_SIGMA_M
from lab.calibration.weights import Noise
from lab.core.checks import Check
from lab.core.errors import LabError, be, counted, error_context
from lab.core.measurements import Measurements, without_copies
from lab.core.progress import Progress, Stage, stages
from lab.core.se3 import Array
from lab.core.significance import VERIFICATION
from lab.core.units import MM, MRAD
from lab.diagnosis.hypothesis import Hypothesis
from lab.formats.measurement_csv import read_measurements
from lab.library.load_run import CalibrationRun
from lab.library.result import Result, error_statistics, exit_code_of, number
from lab.noise.instruments import Instrument, observing
from lab.options.command_options import VerifyOptions
from lab.options.named_instruments import named_instrument
from lab.phrases.phrase import phrase, phrases
from lab.prediction.extrapolation import MOST_UNCOVERED
from lab.sensors.sensor_registry import sensor_named
from lab.verdict.diagnosed import read_as_accepted
from lab.verdict.fit_checks import check_extrapolated, noise_beyond
from lab.verification.change_test import Verified, misread
from lab.verification.change_test import verify as test
from lab.verification.changes import Displacement, PossibleChange
from lab.verification.predicted_points import CalibrationPrediction, predict_measurements

__all__ = ["VerificationResult", "situation_values", "verified_points"]


@dataclass(frozen=True, repr=False, eq=False)
class VerificationResult(Result):
    """Result of testing whether a calibrated arm is within its predicted error, with possible changes if not.

    Attributes:
        calibrated: the run that calibrated the arm.
        measurements: the rows that were used.
        verified: the test, and the hypotheses that it tried.
    """

    command = "verify"
    robot_at = "calibrated.robot"

    options: VerifyOptions
    calibrated: CalibrationRun
    measurements: Measurements
    verified: Verified
    warnings: tuple[str, ...]

    @property
    def good(self) -> bool:
        """True where the measurements are within the predicted error."""
        return self.verified.good

    @cached_property
    def _extrapolated(self) -> NDArray[np.bool_]:
        """``(n,)`` which rows no fitted pose is near, where the run's model is known to lack something."""
        return self.calibrated.estimate.extrapolated(self.measurements.joints)

    @property
    def exit_code(self) -> int:
        """1 beyond the predicted error; 3 within that of a run that is not good, where good is required; else 0."""
        return exit_code_of(self.verdict, self.options.require)

    @property
    def verdict(self) -> str:
        """``bad`` beyond the predicted error; within it ``doubtful`` if the run is not good, else ``good``."""
        return "bad" if not self.good else "good" if self.calibrated.result.verdict == "good" else "doubtful"

    @property
    def serial(self) -> str | None:
        """The serial number of the arm, by the run or the option; None where neither states it."""
        return self.calibrated.serial or self.options.serial

    @property
    def observed_mm(self) -> dict[str, float | int]:
        """Statistics of the observed position errors: mean, rms, p95, max (mm) and count."""
        return error_statistics(self.verified.errors).to_dict()

    @property
    def detectable(self) -> tuple[tuple[str, str, float], ...]:
        """The minimum detectable changes: of what, the unit, and the size in that unit (infinite if none is)."""
        return tuple((name, self._unit(name), MM.of(size)) for name, size in self.verified.would_notice)

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints and ``result.json`` holds: lengths in mm, angles in mrad."""
        found = self.verified
        return {
            "run": str(self.calibrated.folder),
            "robot": self.calibrated.robot.name,
            "serial": self.serial,
            "poses": len(self.measurements),
            "targets": list(self.measurements.targets),
            "good": found.good,
            "verdict": self.verdict,
            "run_verdict": self.calibrated.result.to_dict(),
            "p": found.p,
            "level": VERIFICATION,
            "statistic": found.statistic,
            "freedom": found.numbers,
            "sigma_freedom": found.sigma_dof,
            "tests": {
                name: {"statistic": part.square, "freedom": part.numbers, "p": part.p, "level": found.test.level}
                for name, part in (("parameters", found.test.along), ("rest", found.test.rest))
            },
            "observed_mm": self.observed_mm,
            "extrapolated": {
                "share": float(self._extrapolated.mean()),
                "ids": [self.measurements.ids[i] for i in np.flatnonzero(self._extrapolated)],
            },
            "promised_mm": MM.of(found.expected_m),
            "moved": list(found.moved),
            "situation": situation_values(found.situation),
            "words": phrase(found.check),
            "hypotheses": [_hypothesis(each) for each in found.hypotheses],
            "refit": {name: _displacement(moved) for name, moved in found.refit},
            "would_notice": {f"{name}_{unit}": number(size) for name, unit, size in self.detectable},
            "warnings": list(self.warnings),
        }

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """The observed position errors: ``id``, ``target``, ``error_mm`` (NaN: not measured), ``extrapolated``."""
        ids, targets = self.measurements.ids, self.measurements.targets
        return {
            "id": np.repeat(ids, len(targets)).tolist(),
            "target": [*targets] * len(ids),
            "error_mm": MM.of(self.verified.errors).ravel().tolist(),
            "extrapolated": np.repeat(self._extrapolated, len(targets)).tolist(),
        }

    def _unit(self, what: str) -> str:
        """The unit in which a person reads how far something moved: the base, a target, or a joint's zero."""
        joint = what.removeprefix("joint")
        angular = joint.isdigit() and not self.calibrated.robot.chain.prismatic[int(joint) - 1]
        return "mrad" if angular else "mm"


def situation_values(each: Check | None) -> dict[str, Any] | None:
    """Return the cause of large errors; None where they are small, or no such cause was found."""
    if each is None:
        return None
    kind, data = each.name.partition(".")[2].replace("_", " "), each.data
    refit, left_mm = list(data.get("refit", ())), number(MM.of(data.get("left_m", data.get("after_m"))))
    return {"kind": kind, "words": phrase(each), "refit": refit, "left_mm": left_mm}


def _hypothesis(each: PossibleChange) -> dict[str, Any]:
    return {
        "kind": each.kind,
        "words": phrase(each.check),
        **_displacement(each.extent),
        "parameters": each.parameters,
        "chi2": each.chi2,
        "p": each.p,
        "bic": each.bic,
        "explains": each.explains,
    }


def _displacement(moved: Displacement) -> dict[str, float | None]:
    """Return the size of a displacement; None where it does not apply or cannot be identified."""
    return {
        "shift_mm": number(MM.of(moved.shift_m)),
        "shift_std_mm": number(MM.of(moved.shift_std_m)),
        "turn_mrad": number(MRAD.of(moved.turn_rad)),
        "turn_std_mrad": number(MRAD.of(moved.turn_std_rad)),
    }


_PASSES = 2  # times that all rows are gone through where nothing has changed
_TOO_GOOD = 1 - 1e-4  # a p-value above it: the given noise is too large


def verified_points(
    options: VerifyOptions, calibrated: CalibrationRun, read: Measurements, *, from_file: bool
) -> VerificationResult:
    """Test measured points against the calibrated arm, and find what has moved where they are beyond its prediction.

    Raises:
        LabError: the run did not identify what was measured, or the rows cannot be used.
    """
    _refuse_unseen_base(calibrated, options)
    with stages("verifying") as stage:
        return _tested(options, calibrated, read, stage, from_file=from_file)


def _tested(
    options: VerifyOptions, calibrated: CalibrationRun, read: Measurements, stage: Stage, *, from_file: bool
) -> VerificationResult:
    if calibrated.load is not None and "payload_kg" in calibrated.estimate.arm.conditions:
        read = calibrated.load.with_payload(read)
    read = without_copies(Path(options.file), read)
    rows = read.only("calibrate", "reference", "test")
    rows = rows.with_points()
    calibrated.robot.refuse_impossible(options.file, rows)
    if not len(rows):
        raise LabError(f"{options.file}: no row to be used has a measured point; mark fewer with use = skip")
    if len(stations := dict.fromkeys(rows.stations)) > 1:
        raise LabError(
            f"{options.file}: measured from stations {', '.join(stations)}; verify the rows of each alone, with "
            "--refit base"
        )
    fitted = _if_fitted(calibrated, options, rows) if from_file else []
    tested = f"testing {len(rows):,} rows, twice or more"
    stage(tested)
    noise, stated = _noise(calibrated, options), options.noise_mm is not None or options.instrument is not None
    if not np.isfinite(calibrated.estimate.free_covariance).all():
        raise LabError(
            f"{options.run}: its covariance is unknown, because it has too few poses to estimate the noise; "
            "identify again with more poses, or with --noise-mm"
        )
    with error_context(options.file):
        residual_m = calibrated.estimate.residual_m
        noisy = noise_beyond(options.noise_mm, rows, residual_m, "the run's residuals")
        _refuse_unknown_targets(calibrated, rows, options)
        estimate = calibrated.estimate.as_measured
        observations, prediction = predict_measurements(estimate, rows, noise, given=stated)
        gross = misread(prediction, rows)
        if options.accept:
            rows, gross = read_as_accepted(rows, gross, options.accept)
            rows = rows.only("calibrate", "reference", "test")
            observations, prediction = predict_measurements(estimate, rows, noise, given=stated)
        more = _range_constant(noise.instrument, prediction, observations)
        verified = test(prediction, observations, options.refit, rows, _counted(stage, tested), gross, more)
    extrapolated = [rows.ids[i] for i in np.flatnonzero(calibrated.estimate.extrapolated(rows.joints))]
    messages = [
        *_warnings(calibrated, read, rows, verified),
        *phrases(check_extrapolated("poses", extrapolated, len(rows))),
    ]
    messages += fitted
    warnings = (*phrases(noisy), *messages, *_repeat_where_measured(len(extrapolated), len(rows), verified))
    return VerificationResult(options, calibrated, rows, verified, warnings)


def _range_constant(
    instrument: Instrument | None, prediction: CalibrationPrediction, observed: Observations
) -> list[Hypothesis]:
    """Return a wrong range constant of an instrument that measures ranges from the origin; none of others."""
    if instrument is None or instrument.kind != "spherical":
        return []
    points = prediction.arm.points(observed.inputs, prediction.values)
    sight = points / np.linalg.norm(points, axis=2, keepdims=True)
    return [Hypothesis("range_constant", columns=sight[..., None], units=("m",))]


def _counted(stage: Stage, name: str) -> Progress:
    """Shows what is done of all rows as often as they are gone through: twice, or as often as a change asks for."""
    passed = 0

    def progress(done: int, of: int) -> None:
        nonlocal passed
        stage(name, passed * of + done, max(_PASSES, passed + 1) * of)
        passed += done == of

    return progress


def _refuse_unseen_base(calibrated: CalibrationRun, options: VerifyOptions) -> None:
    observed = calibrated.options.observe
    if sensor_named(observed).in_instrument_frame:
        return
    if "base" not in options.refit:
        raise LabError(
            f"{options.run}: identified with --observe {observed}, so the base's pose in an instrument's frame is "
            "unknown; add --refit base"
        )
    if options.instrument is None and options.noise_mm is None:
        raise LabError(
            f"{options.run}: identified with --observe {observed}, so the noise of points is unknown; add --instrument "
            "or --noise-mm"
        )


def _refuse_unknown_targets(calibrated: CalibrationRun, rows: Measurements, options: VerifyOptions) -> None:
    """Refuse targets that were not identified, unless the tool is fitted anew."""
    known = calibrated.estimate.arm.targets
    unknown = [target for target in rows.targets if target not in known]
    if unknown and "tool" not in options.refit:
        raise LabError(
            f"target {unknown[0]} was not identified (those of the run are {', '.join(known)}); "
            "rename it, or add --refit tool"
        )
    if unknown and calibrated.estimate.process is not None:
        raise LabError(
            f"target {unknown[0]} was not identified, and the group residual of {options.run} covers its own targets "
            "only; measure one of these, or identify again without residual"
        )


def _noise(calibrated: CalibrationRun, options: VerifyOptions) -> Noise:
    """Return the noise of the new measurements: given, else assumed by the run, else estimated by the run."""
    shared = calibrated.estimate.shared
    given = None if shared is None else replace(shared, independent_share=1.0)
    if options.noise_mm is not None:
        return Noise(sigma_m=MM.to_si(options.noise_mm), shared=given)
    if options.instrument is not None:
        return Noise(observing(named_instrument(options.instrument), "points"), shared=given)
    if (known_mm := calibrated.options.noise_mm) is not None:
        return Noise(sigma_m=MM.to_si(known_mm), shared=shared)
    if calibrated.instrument is not None:
        return Noise(calibrated.instrument, readings=calibrated.readings, shared=shared)
    return Noise(sigma_m=max(calibrated.estimate.noise_m, LEAST_SIGMA_M), shared=given)


def _if_fitted(calibrated: CalibrationRun, options: VerifyOptions, rows: Measurements) -> list[str]:
    """Refuse rows that the run was identified from, to the last digit: they verify nothing new.

    Returns:
        Warnings where ``--force`` accepts them; mostly none.
    """
    own = calibrated.folder / "measurements.csv"
    if not own.is_file():
        return []
    chain = calibrated.robot.chain
    fitted = read_measurements(own, chain.joint_names, chain.prismatic)
    if fitted.targets != rows.targets:
        return []
    known = {row.tobytes() for row in _numbers(fitted)}
    again = [i for i, row in enumerate(_numbers(rows)) if row.tobytes() in known]
    if not again:
        return []
    text = (
        f"{options.file}: {len(again)} of {counted(len(rows), 'row')} {be(len(again))} among those that the "
        f"run was identified from (first: {rows.where(again[0])}), so they verify nothing new; measure poses again"
    )
    if not options.force:
        raise LabError(f"{text}, or give --force")
    return [text]


def _numbers(rows: Measurements) -> Array:
    numbers: Array = np.column_stack([rows.joints, rows.points.reshape(len(rows), -1)])
    return numbers


def _warnings(calibrated: CalibrationRun, read: Measurements, rows: Measurements, verified: Verified) -> list[str]:
    chain, messages = calibrated.robot.chain, [*calibrated.warnings, *read.warnings]
    if blank := len(read.only("calibrate", "reference", "test")) - len(rows):
        messages.append(f"{blank} rows have no measured point and are left out")
    outside = chain.beyond_limits(rows.joints, 1e-3)
    messages += [
        f"joint {name}: {rows.where(int(np.argmax(beyond)))} is beyond its limits; check units, signs and offsets"
        for name, beyond in zip(chain.joint_names, outside.T, strict=True)
        if beyond.any()
    ]
    if len(sessions := list(dict.fromkeys(rows.sessions))) > 1:
        messages.append(
            f"sessions {', '.join(sessions)} are treated as one setup; verify each alone if one was set up anew"
        )
    if "payload_kg" in calibrated.estimate.arm.conditions and "payload_kg" not in rows.conditions:
        messages.append("no column payload_kg: the flange is assumed to carry nothing in any pose")
    if verified.undetermined:
        names = ", ".join(verified.undetermined)
        messages.append(
            f"these poses do not determine {names}, which keep the run's values; the test does not depend on them"
        )
    if verified.p_of_all > _TOO_GOOD:
        messages.append(
            f"errors are much smaller than predicted (p = {verified.p_of_all:.6f}): the assumed noise is too large"
        )
    return messages


def _repeat_where_measured(extrapolated: int, count: int, verified: Verified) -> list[str]:
    if verified.good or extrapolated <= MOST_UNCOVERED * count:
        return []
    return [
        "most of these poses are extrapolated, so model discrepancy there may look like a change; measure again near "
        "poses of the run to confirm it"
    ]
