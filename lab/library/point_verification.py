"""Test new measurements against a calibrated arm: is it within its predicted error?"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import PLAUSIBLE_SPREAD, spread
from lab.calibration.statistics.outliers import LEAST_SIGMA_M
from lab.calibration.weights import Noise
from lab.core.checks import Check
from lab.core.errors import LabError, be, counted, error_context
from lab.core.limits import called
from lab.core.measurements import Measurements, without_copies
from lab.core.progress import Progress, Stage, stages
from lab.core.se3 import Array, inverse
from lab.core.significance import VERIFICATION
from lab.core.units import MM, MRAD
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.model import RigidArm
from lab.library.load_run import CalibrationRun
from lab.library.result import Result, error_statistics, exit_code_of, number
from lab.noise.instruments import observing
from lab.options.command_options import VerifyOptions
from lab.options.named_instruments import named_instrument
from lab.phrases.phrase import phrase, phrases
from lab.phrases.verification_phrases import change_text, extent_text, next_step
from lab.prediction.extrapolation import MOST_UNCOVERED
from lab.report import document as doc
from lab.report.charts.chart import axes_picture, log_ticks
from lab.report.charts.marks import Axes
from lab.report.document import sentence, short
from lab.report.page_scene import ArmScene, Arrows, posed_arm
from lab.report.plots import Spread, histograms
from lab.report.scene import LARGEST_FACTOR, drawn_rows, magnification, mean_lengths, moved, reach_of
from lab.report.style import AFTER, ARROW_AFTER, BEFORE, INK, MUTED, PREDICTED, rgb
from lab.sensors.sensor_registry import sensor_named
from lab.verdict.fit_checks import check_extrapolated, noise_beyond
from lab.verification.change_test import Displacement, Hypothesis, Verified
from lab.verification.change_test import verify as test
from lab.verification.predicted_points import CalibrationPrediction, predict_measurements
from lab.verification.situation import another_unit

__all__ = ["VerificationResult", "drawn_poses", "verified_points"]


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
    shown_by = "lab.library.point_verification:_verification_document"
    drawn_by = "lab.library.point_verification:_errors_picture"
    recorded_by = "lab.report.views.error_recording:record_verification"

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
            "situation": _situation(found.situation),
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


def _situation(each: Check | None) -> dict[str, Any] | None:
    """Return the cause of large errors; None where they are small, or no such cause was found."""
    if each is None:
        return None
    kind, data = each.name.removeprefix("situation.").replace("_", " "), each.data
    refit, left_mm = list(data.get("refit", ())), MM.of(data["left_m"])
    return {"kind": kind, "words": phrase(each), "refit": refit, "left_mm": left_mm}


def _hypothesis(each: Hypothesis) -> dict[str, Any]:
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


_MOST_HYPOTHESES = 20  # that are listed
_MOST_DRAWN = 8  # of them on the card
_ARROW = 0.15  # of the reach: how long the mean error is to be drawn
_RATE = f"An unchanged arm fails the test in {100 * VERIFICATION:g} % of all cases."


def _verification_document(result: VerificationResult) -> doc.Document:
    """The verdict and its test, the errors, what may have changed, and the minimum detectable change."""
    found, robot = result.verified, result.calibrated.robot
    within = "within the predicted error" if found.good else "beyond the predicted error"
    explained = doc.Figure("causes-figure", _causes_picture(result), _CAUSES)
    spread = doc.Figure("errors-figure", (_errors_picture(result),), _SPREAD)
    first, *others = (explained, spread) if explained.pictures else (spread,)
    arm = doc.Scene("arm-scene", lambda: _scene(result), _ARM)
    return doc.Document(
        f"{called(robot.name, result.serial)}: {within}",
        (
            *_card(result, first).everywhere,
            doc.Warnings(result.warnings),
            doc.Section(
                "Errors, observed and predicted",
                (arm, doc.Paragraph(sentence(phrase(found.check))), *_errors(result), *others),
            ),
            doc.Section("Single changes that would explain the errors", (_hypotheses(result),)),
            doc.Section("Refitted parts", (_refitted(result),)),
            doc.Section("Minimum detectable change", (_detectable(result),) if found.good else ()),
        ),
    )


_CAUSES = (
    "What each single change would leave of the errors, as a multiple of the predicted ones. What reaches the dotted "
    "line (1) explains them. Logarithmic axis."
)
_SPREAD = "The errors of the new measurements, with their root mean square and the predicted one. Logarithmic axis."
_ARM = "The arm at the new poses. Arrows lead from the predicted to the measured position of the first target."


@doc.guarded
def _card(result: VerificationResult, figure: doc.Figure) -> doc.Card:
    found, measured = result.verified, result.measurements
    observed_m = MM.to_si(float(result.observed_mm["rms"]))
    numbers = [
        ("predicted error", short(MM.of(found.expected_m), "mm"), ""),
        ("error now", short(result.observed_mm["rms"], "mm"), ""),
    ]
    alike = found.check.data["alike"]
    if found.situation is None and len(alike) == 1:
        numbers.append((change_text(alike[0]), extent_text(alike[0]), ""))
    elif not found.good and found.expected_m > 0:
        numbers.append(("larger by a factor of", short(observed_m / found.expected_m), ""))
    within = "within" if found.good else "beyond"
    date = result.calibrated.options.date
    calibration = f"the calibration{f' of {date}' if date else ''} ({result.calibrated.result.description})"
    about = (
        f"Root mean squares of {counted(int(result.observed_mm['count']), 'point')} in "
        f"{counted(len(measured), 'new pose')}, against {calibration}. {_RATE}"
    )
    kind: Mapping[str, Literal["good", "doubtful", "bad"]] = {"good": "good", "doubtful": "doubtful", "bad": "bad"}
    return doc.Card(
        ("Verdict: ", doc.Badge(result.verdict, kind[result.verdict]), f" ({within} the predicted error)"),
        tuple(numbers),
        about,
        next_step(found.check, result.verdict),
        (figure,),
    )


def _causes_picture(result: VerificationResult) -> tuple[doc.Picture, ...]:
    """Draw how large the errors would be relative to the predicted ones if one thing has changed; none if good."""
    found = result.verified
    drawn = [each for each in found.hypotheses if each.chi2 > 0][:_MOST_DRAWN]
    if not drawn or not found.numbers:
        return ()
    sizes = np.sqrt([found.statistic, *(each.chi2 for each in drawn)]) / np.sqrt(found.numbers)
    names = ["as measured", *(change_text(each.check) for each in drawn)]
    explains = np.array([False, *(each.explains for each in drawn)])
    at = np.arange(len(names))[::-1]

    def draw(axes: Axes) -> None:
        log_ticks(axes, "x", min(0.5, float(sizes.min()) / 1.3), float(sizes.max()) * 1.6)
        axes.axvline(1, color=INK, linewidth=1.2, linestyle=":")
        for which, colour, mark in ((~explains, MUTED, "o"), (explains, PREDICTED, "D")):
            axes.hlines(at[which], np.ones(which.sum()), sizes[which], colors=colour, linewidth=1.2)
            axes.plot(sizes[which], at[which], mark, color=colour, markersize=7)
        axes.set_yticks(at, names)
        axes.set(ylim=(-0.6, len(names) - 0.4), xlabel="errors left over predicted")
        axes.grid(visible=False, axis="y")

    best = ", ".join(name for name, each in zip(names, explains, strict=True) if each) or "no single change"
    size = (3.8, 0.75 + 0.24 * len(names))
    label = f"Errors left by each single change: {best} explains them"
    return (axes_picture("causes", label, size, draw, (0.3 + 0.078 * max(map(len, names)), 0.5, 0.15, 0.1)),)


def drawn_poses(result: VerificationResult) -> tuple[Measurements, RigidArm, Array, Array]:
    """Return the poses that are drawn, of many an evenly spaced part, and what the calibrated arm predicts there.

    Returns:
        The measurements, the arm's geometry and its parameters with the base that the instrument sees, and the
        predicted points ``(m, k, 3)`` m in the instrument's frame, NaN where none was measured.
    """
    calibrated, values = result.calibrated, result.verified.values
    data = result.measurements.take(drawn_rows(len(result.measurements)))
    arm = calibrated.robot.arm_with(data.targets, calibrated.estimate.groups)
    predicted = np.where(data.seen[:, :, None], arm.points(data.inputs(arm.conditions), values), np.nan)
    return data, arm.rigid, values[: len(arm.rigid.names)], predicted


def _scene(result: VerificationResult) -> ArmScene:
    data, arm, values, predicted = drawn_poses(result)
    model = result.calibrated.robot.model
    scene = posed_arm(model, arm, values, data.joints, data.ids)
    T_world_instrument = model.T_world_frame0 @ inverse(arm.T_tracker_frame0(values))
    points = moved(T_world_instrument, predicted)
    vectors = (data.points - predicted) @ T_world_instrument[:3, :3].T
    lengths = mean_lengths(vectors)
    reach = reach_of(model.T_world_frame0, points[np.isfinite(points).all(axis=2)], scene.legs)
    factor = min(max(magnification(float(np.nanmean(lengths)), _ARROW * reach), 1.0), LARGEST_FACTOR)
    colour = rgb(ARROW_AFTER if result.good else BEFORE)
    return replace(
        scene,
        points=points[:, 0],
        arrows=(Arrows("measured less predicted", vectors[:, 0], factor, colour),),
        columns={"error": lengths},
    )


def _errors_picture(result: VerificationResult) -> doc.Picture:
    """The observed errors as a histogram, with their root mean square and the predicted one."""
    found = result.verified
    observed = MM.to_si(float(result.observed_mm["rms"]))
    spreads = [
        Spread(found.errors, AFTER if found.good else BEFORE, ("observed: rms", observed)),
        Spread(found.errors[:0], PREDICTED, ("predicted: rms", found.expected_m)),
    ]
    return histograms("errors", spreads, "position error")


@doc.guarded
def _errors(result: VerificationResult) -> tuple[doc.Block, ...]:
    observed, measured = result.observed_mm, result.measurements
    numbers = [short(observed[key]) for key in ("mean", "rms", "p95", "max")]
    rows = (
        ("observed", *numbers, f"{observed['count']:,}"),
        ("predicted", "", short(MM.of(result.verified.expected_m)), "", "", ""),
    )
    below = (
        f"{len(measured)} new poses, targets {', '.join(measured.targets)}, against the run "
        f"{result.calibrated.folder}. The predicted error follows from the calibration's covariance and the "
        "instrument's noise."
    )
    return doc.Table(("", "mean", "rms", "95 %", "max", "points"), rows, "Position error, mm"), doc.Paragraph(
        below, "note"
    )


def _hypotheses(result: VerificationResult) -> doc.Table:
    listed = result.verified.hypotheses
    rows = tuple(
        (
            phrase(each.check),
            short(each.chi2),
            short(each.p) if each.p > 0 else "< 1e-300",
            short(each.bic),
            "yes" if each.explains else "no",
        )
        for each in listed
    )
    kinds = tuple("" if each.explains else "quiet" for each in listed)
    columns = ("possible change, likeliest first", "remaining χ²", "p", doc.Column("BIC"), "explains the errors")
    caption = "Possible changes, each with what it leaves" if rows else ""
    return doc.Table(columns, rows, caption, kinds, most_rows=_MOST_HYPOTHESES, folded=True)


def _refitted(result: VerificationResult) -> doc.Table:
    rows = tuple(
        (
            name,
            *(
                short(MM.of(size)) if size == size else "–"
                for size in (moved.shift_m, moved.shift_std_m, moved.turn_rad, moved.turn_std_rad)
            ),
        )
        for name, moved in result.verified.refit
    )
    return doc.Table(("", "moved by, mm", "1σ", "turned by, mrad", "1σ"), rows)


def _detectable(result: VerificationResult) -> doc.Table:
    rows = tuple(
        (name.replace("joint", "zero of joint "), short(size), unit)
        for name, unit, size in result.detectable
        if size < float("inf")
    )
    caption = "Smallest change that the test detects in 95 of 100 such files"
    return doc.Table(("", "by", "unit"), rows, caption)


_LEAST_SPREAD = 3  # poses whose spread is compared
_PASSES = 2  # times that all rows are gone through where nothing has changed
_SPREAD_OF = 4_000  # of more poses the spread of so many is as good
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
        observations, prediction = predict_measurements(calibrated.estimate, rows, noise, given=stated)
        _refuse_implausible(prediction, observations)
        names = [rows.where(i) for i in range(len(rows))]
        verified = test(prediction, observations, options.refit, names, _counted(stage, tested))
    extrapolated = [rows.ids[i] for i in np.flatnonzero(calibrated.estimate.extrapolated(rows.joints))]
    messages = [
        *_warnings(calibrated, read, rows, verified),
        *phrases(check_extrapolated("poses", extrapolated, len(rows))),
    ]
    messages += fitted
    warnings = (*phrases(noisy), *messages, *_repeat_where_measured(len(extrapolated), len(rows), verified))
    return VerificationResult(options, calibrated, rows, verified, warnings)


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


def _refuse_implausible(prediction: CalibrationPrediction, observations: Observations) -> None:
    some = observations.thinned(_SPREAD_OF)
    predicted = prediction.arm.points(some.inputs, prediction.values)
    spreads = [spread(np.where(np.isnan(some.points), np.nan, points)) for points in (some.points, predicted)]
    if (
        len(observations.inputs) >= _LEAST_SPREAD
        and not PLAUSIBLE_SPREAD[0] <= spreads[0] / spreads[1] <= PLAUSIBLE_SPREAD[1]
    ):
        other = another_unit(prediction, observations)
        raise LabError(
            f"the measured points spread {spreads[0] / spreads[1]:.3g} times as far as the robot's at these poses: "
            f"{'wrong unit, or another robot' if other is None else phrase(other)}"
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
