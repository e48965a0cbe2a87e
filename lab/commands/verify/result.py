"""Result of a verification: typed, and as plain values for its JSON files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lab.commands.calibrate.load_run import CalibrationRun
from lab.commands.result import Result, error_statistics, exit_code_of, number
from lab.commands.verify.options import VerifyOptions
from lab.core.checks import Check
from lab.core.limits import called
from lab.core.measurements import Measurements
from lab.core.significance import VERIFICATION
from lab.render.document import (
    PAGE,
    TERMINAL,
    Badge,
    Block,
    Column,
    Document,
    Figure,
    Paragraph,
    Picture,
    Section,
    Table,
    Warnings,
    sentence,
    short,
)
from lab.render.phrases.registry import phrase
from lab.render.plots import Spread, histograms
from lab.render.style import AFTER, BEFORE, PREDICTED
from lab.verification.test import Displacement, Hypothesis, Verified

if TYPE_CHECKING:
    from lab.render.document import Document

__all__ = ["VerificationResult", "errors_picture"]


@dataclass(frozen=True, repr=False, eq=False)
class VerificationResult(Result):
    """Result of testing whether a calibrated arm is within its predicted error, with possible changes if not.

    Attributes:
        options: of the command.
        calibrated: the run that calibrated the arm.
        measurements: the rows that were used.
        verified: the test, and the hypotheses that it tried.
    """

    command = "verify"
    shown_by = "lab.commands.verify.result:_verification_document"
    drawn_by = "lab.commands.verify.result:errors_picture"
    recorded_by = "lab.commands.verify.recording:record_verification"

    options: VerifyOptions
    calibrated: CalibrationRun
    measurements: Measurements
    verified: Verified
    warnings: tuple[str, ...]

    @property
    def model_sha256(self) -> str:
        """Digest of the robot's description."""
        return self.calibrated.robot.sha256

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
        return tuple((name, self._unit(name), 1e3 * size) for name, size in self.verified.would_notice)

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
            "sigma_freedom": found.sigma_freedom,
            "tests": {
                name: {"statistic": part.square, "freedom": part.numbers, "p": part.p, "level": found.test.level}
                for name, part in (("parameters", found.test.along), ("rest", found.test.rest))
            },
            "observed_mm": self.observed_mm,
            "extrapolated": {
                "share": float(self._extrapolated.mean()),
                "ids": [self.measurements.ids[i] for i in np.flatnonzero(self._extrapolated)],
            },
            "promised_mm": 1e3 * found.promised_m,
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
            "error_mm": (1e3 * self.verified.errors).ravel().tolist(),
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
    refit, left_mm = list(data.get("refit", ())), 1e3 * data["left_m"]
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
        "shift_mm": number(1e3 * moved.shift_m),
        "shift_std_mm": number(1e3 * moved.shift_std_m),
        "turn_mrad": number(1e3 * moved.turn_rad),
        "turn_std_mrad": number(1e3 * moved.turn_std_rad),
    }


_MOST_HYPOTHESES = 20  # that are listed
_ADVICE = {
    "base": "--refit base says where it is now, and whether the rest of the arm is good",
    "tool": "--refit tool says where it is now, and whether the rest of the arm is good",
    "joint": "set that zero anew, or calibrate anew",
    "reading": "measure that pose again, or mark its row use = skip",
}


def _verification_document(result: VerificationResult) -> Document:
    """The verdict and its test, the errors, what may have changed, and the minimum detectable change."""
    found, robot = result.verified, result.calibrated.robot
    verdict = "within the predicted error" if found.good else "beyond the predicted error"
    rate = f"(an unchanged arm fails this test in {100 * VERIFICATION:g} % of all cases)"
    return Document(
        f"{called(robot.name, result.serial)}: {verdict}",
        (
            Paragraph((Badge("good" if found.good else "bad", "good" if found.good else "bad"), f" {rate}")),
            Paragraph(sentence(phrase(found.check)), "lead"),
            Paragraph(f"The run that calibrated the arm is {result.calibrated.result.words}."),
            Warnings(result.warnings),
            Section("Errors, observed and predicted", (*_errors(result), _histogram(result))),
            Section("What alone would explain it", (_hypotheses(result), *_advice(result))),
            Section("What was fitted anew", (_refitted(result),)),
            Section("Minimum detectable change", (_detectable(result),) if found.good else ()),
        ),
    )


def errors_picture(result: VerificationResult) -> Picture:
    """The observed errors as a histogram, with their root mean square and the predicted one."""
    found = result.verified
    observed = float(result.observed_mm["rms"]) / 1e3
    spreads = [
        Spread(found.errors, AFTER if found.good else BEFORE, ("observed: rms", observed)),
        Spread(found.errors[:0], PREDICTED, ("predicted: rms", found.promised_m)),
    ]
    return histograms("errors", spreads, "position error")


def _errors(result: VerificationResult) -> tuple[Block, ...]:
    observed, measured = result.observed_mm, result.measurements
    numbers = [short(observed[key]) for key in ("mean", "rms", "p95", "max")]
    rows = (
        ("observed", *numbers, f"{observed['count']:,}"),
        ("predicted", "", short(1e3 * result.verified.promised_m), "", "", ""),
    )
    below = (
        f"{len(measured)} new poses, targets {', '.join(measured.targets)}, against the run "
        f"{result.calibrated.folder}. Predicted: what the calibration's covariance and the instrument's noise let one "
        "expect here."
    )
    return Table(("", "mean", "rms", "95 %", "max", "points"), rows, "Position error, mm"), Paragraph(below, "note")


def _histogram(result: VerificationResult) -> Figure:
    caption = "The errors of the new measurements, with their root mean square and the predicted one. Logarithmic axis."
    return Figure("errors-figure", (errors_picture(result),), caption)


def _hypotheses(result: VerificationResult) -> Table:
    listed = result.verified.hypotheses
    rows = tuple(
        (phrase(each.check), short(each.chi2), _chance(each.p), short(each.bic), "yes" if each.explains else "no")
        for each in listed
    )
    kinds = tuple("" if each.explains else "quiet" for each in listed)
    columns = ("what may have changed, the best first", "χ² left", "p", Column("BIC"), "explains it")
    return Table(columns, rows, row_kinds=kinds, most_rows=_MOST_HYPOTHESES)


def _chance(p: float) -> str:
    return short(p) if p > 0 else "< 1e-300"


def _advice(result: VerificationResult) -> tuple[Block, ...]:
    """Advise what to do if a single part has changed and the first sentence does not state it."""
    moved = () if result.verified.situation is not None else result.verified.moved
    return (Paragraph(sentence(_ADVICE[moved[0]]), shown_in=PAGE | TERMINAL),) if len(moved) == 1 else ()


def _refitted(result: VerificationResult) -> Table:
    rows = tuple(
        (
            name,
            *(
                short(1e3 * size) if size == size else "–"
                for size in (moved.shift_m, moved.shift_std_m, moved.turn_rad, moved.turn_std_rad)
            ),
        )
        for name, moved in result.verified.refit
    )
    return Table(("", "moved by, mm", "1σ", "turned by, mrad", "1σ"), rows)


def _detectable(result: VerificationResult) -> Table:
    """Tabulate the changes that the test would have detected, with their units."""
    rows = tuple((name, short(size), unit) for name, unit, size in result.detectable if size < float("inf"))
    caption = "In 95 of 100 such files the test would detect it if one of these were off by"
    return Table(("", "by", "unit"), rows, caption)
