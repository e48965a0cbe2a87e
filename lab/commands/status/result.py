"""The state of the arms of a folder of runs: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.commands.result import Result
from lab.commands.status.arm import ArmStatus
from lab.commands.status.history import Check, LeftOut
from lab.commands.status.options import StatusOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["StatusResult"]


@dataclass(frozen=True, repr=False, eq=False)
class StatusResult(Result):
    """The state of every arm of a folder of runs on a day.

    Attributes:
        options: what was asked.
        on: the day.
        arms: the worst first.
        left_out: runs that could not be used, and why not.
    """

    options: StatusOptions
    on: date
    arms: tuple[ArmStatus, ...]
    left_out: tuple[LeftOut, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """The runs that could not be used."""
        return tuple(f"{each.folder}: left out: {each.reason}" for each in self.left_out)

    @property
    def exit_code(self) -> int:
        """1 where an arm is bad; 3 where all are to be good and one is not; else 0."""
        states = {each.state for each in self.arms}
        if "bad" in states:
            return 1
        return 3 if self.options.require and states != {"good"} else 0

    @property
    def model_sha256(self) -> str:
        """The digest of the digests of all robots' files."""
        models = sorted({check.model_sha256 for arm in self.arms for check in arm.checks})
        return sha256("".join(models).encode()).hexdigest()

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints and ``result.json`` holds: days as YYYY-MM-DD, errors in mm."""
        return {
            "folder": str(self.options.folder),
            "on": self.on.isoformat(),
            "every_days": self.options.every_days,
            "arms": [_arm(each) for each in self.arms],
            "left_out": [{"run": str(each.folder), "reason": each.reason} for each in self.left_out],
            "warnings": list(self.warnings),
        }

    def document(self) -> "Document":
        """What a person reads: every arm in a row, the checks over time, what changed, what was left out."""
        from lab.commands.status.document import status_document

        return status_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each arm, as ``status.csv`` has it; empty where nothing is known."""
        rows = [_arm(each) for each in self.arms]
        flat = [
            {
                "serial": row["serial"],
                "robot": row["robot"],
                "state": row["state"],
                **{
                    f"last_{kind}_{key}": None if row[f"last_{kind}"] is None else row[f"last_{kind}"][key]
                    for kind in ("calibration", "verification")
                    for key in ("date", "verdict")
                },
                "error_then_mm": row["error_then_mm"],
                "error_now_mm": row["error_now_mm"],
                "slope_mm_per_year": None if row["slope"] is None else row["slope"]["mm_per_year"],
                "slope_half_width_95": None if row["slope"] is None else row["slope"]["half_width_95"],
                "calibrations": row["calibrations"],
                "verifications": row["verifications"],
                "changes": None if row["changes"] is None else len(row["changes"]),
                "next_due": row["next_due"],
            }
            for row in rows
        ]
        return {name: ["" if row[name] is None else row[name] for row in flat] for name in (flat or [{}])[0]}

    def plot(self) -> "Figure":
        """Draw the checks of every arm over time."""
        from lab.commands.status.figures import checks_picture

        return checks_picture(self).draw()

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json``, ``status.csv``, ``status.prom`` and ``report.html``."""
        from lab.commands.run_folder import write_config, write_json
        from lab.commands.status.metrics import exposition
        from lab.formats.csv_table import write_columns

        write_config(folder, "status", self.options, self.model_sha256)
        write_json(folder / "result.json", self.to_dict())
        write_columns(folder / "status.csv", {name: [*map(str, each)] for name, each in self.columns().items()})
        (folder / "status.prom").write_text(exposition(self.arms, len(self.left_out)), encoding="utf-8")
        self.report(folder / "report.html")


def _arm(arm: ArmStatus) -> dict[str, Any]:
    slope, trend = arm.slope, arm.trend
    return {
        "serial": arm.serial,
        "robot": arm.robot,
        "state": arm.state,
        "last_calibration": _check(arm.calibration),
        "last_verification": _check(arm.verification),
        "error_then_mm": arm.error_then_mm,
        "error_now_mm": arm.error_now_mm,
        "slope": None
        if slope is None
        else {"mm_per_year": slope.per_year, "half_width_95": slope.half_width, "verifications": slope.count},
        "calibrations": sum(each.calibrates for each in arm.checks),
        "verifications": sum(not each.calibrates for each in arm.checks),
        "changes": None if trend is None else trend.to_dict()["changes"],
        "next_due": None if arm.due is None else arm.due.isoformat(),
    }


def _check(check: Check | None) -> dict[str, Any] | None:
    if check is None:
        return None
    on = None if check.on is None else check.on.isoformat()
    return {"run": str(check.folder), "date": on, "verdict": check.verdict, "error_mm": check.error_mm}
