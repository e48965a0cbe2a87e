"""A calibrated arm, read back from the folder of the run that identified it."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.campaign.robot import Robot, load_robot, load_virtual
from lab.commands.payload.known_payload import LOAD_FILE, HandLoad, read_hand_load
from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.csv_table import CsvTable
from lab.kinematics.effects.arm import Arm
from lab.kinematics.effects.groups import CAMPAIGN_SPECIFIC
from lab.kinematics.inverse.branches import NominalInverse
from lab.kinematics.model import RigidArm

_TURN = ("tool.rx", "tool.ry", "tool.rz")


@dataclass(frozen=True)
class Calibrated:
    """What a run found out about an arm, as far as it holds on another day.

    Attributes:
        folder: of the run.
        arm: as it was identified, without the groups of effects that say nothing of another day.
        values: ``(p,)`` of the arm, as exported: the most likely ones of those that predict the same.
        before: ``(p,)`` nominal links with the base and tool that suit them best.
        R_last_tool: rotation ``(3, 3)`` of the measured tool in the last frame; one where no orientation was measured.
        left_out: groups of effects of the run's own day.
        identified: the parameters that ``covariance`` ``(f, f)`` is of.
        result: what ``result.json`` holds.
        options: of the run.
        load: at the hand, where that was identified.
    """

    folder: Path
    robot: Robot
    arm: Arm
    values: Array
    before: Array
    R_last_tool: Array
    identified: tuple[str, ...]
    covariance: Array
    left_out: tuple[str, ...]
    result: dict[str, Any]
    options: dict[str, Any]
    load: HandLoad | None

    @property
    def geometry(self) -> tuple[RigidArm, Array]:
        """The arm without its effects, and its parameters."""
        arm = self.arm.rigid
        return arm, self.values[: len(arm.names)]

    def nominal_inverse(self, target: int) -> NominalInverse:
        """What its controller computes with, to bring a target somewhere."""
        arm = self.arm.rigid
        return NominalInverse(arm, self.before[: len(arm.names)], target)

    @property
    def compliance(self) -> Array:
        """The joints' compliances ``(joints,)`` rad/Nm (m/N) that were identified; zero of joints without one."""
        found = dict(zip(self.arm.names, self.values.tolist(), strict=True))
        return np.array([found.get(f"joint{i + 1}.compliance", 0.0) for i in range(self.robot.chain.size)])

    @property
    def groups(self) -> tuple[str, ...]:
        """Of effects that the arm has."""
        return self.arm.groups

    def lacking(self, sigma_m: float) -> tuple[float, float, int | None]:
        """What the model lacks (m a coordinate), a factor of its covariance, and sigma's degrees of freedom.

        Where the run's residuals were more than its noise, or that was estimated, they are the measure.

        Args:
            sigma_m: noise of new measurements.
        """
        result = self.result
        if result["noise_known"] and result["adequate"] is not False:
            return 0.0, 1.0, None
        residual_m = (result["residual_mm"] or 0.0) / 1e3
        noise_m = result["noise_mm"] / 1e3 if result["noise_known"] else sigma_m
        larger = (residual_m / noise_m) ** 2 if result["noise_known"] else 1.0
        return float(np.sqrt(max(residual_m**2 - noise_m**2, 0.0))), larger, result["freedom"]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What whoever builds on the run should be told of it."""
        result, said = self.result, [*self.robot.warnings]
        if result.get("verdict") != "good":
            said.append(f"the verdict of the run is '{result.get('verdict')}': what it promises is not to be believed")
        if result.get("adequate") is False:
            said.append(f"of the run: {result['adequacy']}: what the model lacked is taken for noise")
        if self.left_out:
            said.append(f"of the run: {', '.join(self.left_out)} was of its own day, and is left out")
        return tuple(said)

    def refuse_unfit(self, what: str) -> None:
        """A LabError for a run whose verdict is not good: ``what`` is not to be built on it."""
        word, reason = self.result.get("verdict"), self.result.get("reason")
        if word != "good":
            why = f" ({reason})" if reason else ""
            mend = "measure poses to judge it by" if word == "not judged" else "mend what is bad"
            raise LabError(
                f"{self.folder}: the verdict of this run is '{word}'{why}, so {what} is refused; {mend}, or say --force"
            )


def read_calibrated(folder: Path, load: Path | None = None) -> Calibrated:
    """Read a run of ``lab calibrate`` or ``lab identify``.

    Args:
        load: the folder of a run of ``lab payload``, whose load it carries from now on; by default that which it was
            identified with, if any.

    Raises:
        LabError: it is no such run, lacks a file, or is of another robot than the one of that name here.
    """
    config, result = (_json(folder, name, dict) for name in ("config.json", "result.json"))
    command, options = config.get("command"), config.get("options")
    if command not in ("calibrate", "identify") or not isinstance(options, dict):
        raise LabError(f"{folder}: is no run of lab calibrate or lab identify; give the folder of one")
    try:
        loading = load_virtual if command == "calibrate" else load_robot
        robot = loading(str(options.get("robot")))
    except LabError as error:
        raise LabError(f"{folder}: the robot it is of cannot be loaded from here: {error}") from error
    if config.get("model_sha256") != robot.sha256:
        raise LabError(
            f"{folder}: is a run of another robot: the files of '{options.get('robot')}' are not those that it was "
            "made with; identify again"
        )
    carried = load or (folder if (folder / LOAD_FILE).is_file() else None)
    hand = None if carried is None else read_hand_load(carried)
    robot = robot if hand is None else hand.carried_by(robot)
    rows = {row["name"]: row for row in _rows(folder)}
    targets = tuple(name.split(".")[1] for name in rows if name.startswith("tool.") and name.endswith(".x"))
    if not targets:
        raise LabError(f"{folder}/parameters.json: has no tool (tool.p1.x…), so nothing is there to be aimed")
    chosen = [name for name in str(result.get("model")).split("+") if name != "geometric"]
    arm = robot.arm_with(targets, [name for name in chosen if name not in CAMPAIGN_SPECIFIC])
    left_out = tuple(name for name in chosen if name in CAMPAIGN_SPECIFIC)
    if missing := [name for name in arm.names if name not in rows]:
        raise LabError(f"{folder}/parameters.json: has no {missing[0]}: it is of another robot, or was cut short")
    exported, before = (np.array([rows[name][key] for name in arm.names]) for key in ("exported", "nominal"))
    turn = np.array([rows[name]["exported"] for name in _TURN]) if set(_TURN) <= set(rows) else np.zeros(3)
    names, covariance = _covariance(folder / "covariance.csv", arm.names)
    return Calibrated(
        folder, robot, arm, exported, before, se3.exp(turn), names, covariance, left_out, result, options, hand
    )


def _json(folder: Path, name: str, kind: type) -> Any:
    """A file of the run."""
    path = folder / name
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise LabError(
            f"{path}: cannot be read ({error.strerror}); give the folder of a run of lab calibrate or lab identify"
        ) from error
    except ValueError as error:
        raise LabError(f"{path}: not JSON ({error}); run lab calibrate or lab identify again") from error
    if not isinstance(content, kind):
        raise LabError(f"{path}: does not hold what a run writes; run lab calibrate or lab identify again")
    return content


def _rows(folder: Path) -> list[dict[str, Any]]:
    """The parameters."""
    rows = _json(folder, "parameters.json", list)
    for row in rows:
        numbers = [row.get(key) for key in ("exported", "nominal")] if isinstance(row, dict) else [None]
        if not all(isinstance(number, int | float) for number in numbers) or not isinstance(row.get("name"), str):
            raise LabError(f"{folder}/parameters.json: a row lacks name, nominal or exported; identify again")
    return list(rows)


def _covariance(path: Path, names: Sequence[str]) -> tuple[tuple[str, ...], Array]:
    """The part of the covariance that is of these parameters, and their names."""
    if not path.is_file():
        raise LabError(f"{path}: is missing: an older version of the lab made this run; make it again")
    table = CsvTable(path)
    labels = table.texts("parameter")
    if labels is None or tuple(table.header[1:]) != labels:
        raise LabError(f"{path}: its rows are not those of its columns; identify again")
    kept = [i for i, name in enumerate(labels) if name in names]
    cells = [row[1:] for row in table.rows]
    try:
        matrix = np.array(cells, dtype=np.float64)
    except ValueError as error:
        raise LabError(f"{path}: {error}; identify again") from error
    return tuple(labels[i] for i in kept), matrix[np.ix_(kept, kept)]
