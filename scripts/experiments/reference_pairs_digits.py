"""Count the digits to which the lab agrees with the reference pairs of docs/reference/pairs.

Per set: correct digits of the parameters, residuals, sum of squares, covariance, predicted points and their covariance,
as ``docs/reference/reference_pairs.md`` defines them, and the condition number, which costs digits.
"""

import json
import math
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from shared import Answer, Document, Flag, Table, run_script

import lab
from lab.calibration.fit_options import FitOptions
from lab.calibration.identification import Identification, identify
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.robots.robot import Robot

__all__ = ["FOLDER", "Digits", "answer", "compared", "measured", "required", "robot_of", "wishes"]

FOLDER = Path(__file__).parents[2] / "docs" / "reference" / "pairs"
MOST_DIGITS = 16.0  # of a double
LEAST_SIZE = 1e-3  # m or rad: smaller parameters are compared as if they had this size
_TARGET_DIGITS = 8.0  # of a well-conditioned set
_LOST = 2.0  # digits below those that rounding and the condition number leave

_MECHANISMS = {
    "3-RPR": Template("""
frame = [
    { name = "A1", path = [{ x_m = $A1_x }, { y_m = $A1_y }] },
    { name = "A2", path = [{ x_m = $A2_x }, { y_m = $A2_y }] },
    { name = "A3", path = [{ x_m = $A3_x }, { y_m = $A3_y }] },
    { name = "centre", path = [{ x_m = 0, passive = true }, { y_m = 0, passive = true }] },
    { name = "platform", on = "centre", path = [{ rz_deg = 0, passive = true }] },
    { name = "B1", on = "platform", path = [{ x_m = $B1_x }, { y_m = $B1_y }] },
    { name = "B2", on = "platform", path = [{ x_m = $B2_x }, { y_m = $B2_y }] },
    { name = "B3", on = "platform", path = [{ x_m = $B3_x }, { y_m = $B3_y }] },
]
rod = [
    { name = "leg1", between = ["B1", "A1"], joint = "q1" },
    { name = "leg2", between = ["B2", "A2"], joint = "q2" },
    { name = "leg3", between = ["B3", "A3"], joint = "q3" },
]
"""),
    "five-bar": Template("""
frame = [
    { name = "crank1", path = [{ x_m = $crank1_x }, { y_m = $crank1_y }, { rz_deg = $crank1_rz, joint = "q1" }] },
    { name = "crank2", path = [{ x_m = $crank2_x }, { y_m = $crank2_y }, { rz_deg = $crank2_rz, joint = "q2" }] },
    { name = "elbow1", on = "crank1", path = [{ x_m = $elbow1_x }] },
    { name = "elbow2", on = "crank2", path = [{ x_m = $elbow2_x }] },
    { name = "platform", path = [{ x_m = 0, passive = true }, { y_m = 0.5, passive = true }] },
]
rod = [
    { name = "rod1", between = ["platform", "elbow1"], length_m = $rod1_length },
    { name = "rod2", between = ["platform", "elbow2"], length_m = $rod2_length },
]
"""),
}


@dataclass(frozen=True)
class Options:
    """Sets to compare."""

    folder: Path = FOLDER
    """The folder of the pairs, one JSON file each."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Digits:
    """Correct digits of each kind of result; None where a set has none because its rank is deficient.

    Attributes:
        rank: of the lab, with the number of parameters that it fits.
    """

    parameters: float | None
    residuals: float
    sum_of_squares: float
    covariance: float | None
    predicted: float
    predicted_covariance: float
    rank: tuple[int, int]

    @property
    def least(self) -> float:
        """The fewest digits of any result."""
        found = (self.parameters, self.residuals, self.sum_of_squares, self.covariance, self.predicted)
        return min(each for each in (*found, self.predicted_covariance) if each is not None)


def required(pair: Mapping[str, Any]) -> float:
    """Return the digits that the condition number leaves: 15 less its logarithm less two, 8 at most."""
    return min(_TARGET_DIGITS, 15 - math.log10(float(pair["results"]["condition"])) - _LOST)


def robot_of(pair: Mapping[str, Any]) -> Robot:
    """Make the lab's robot of a pair."""
    robot, nominal = pair["robot"], pair["nominal"]
    tool = {each: [float(nominal[f"tool.{each}.{axis}"]) for axis in "xyz"] for each in robot["targets"]}
    slides = [joint["type"] == "prismatic" for joint in robot["joints"]]
    if robot["convention"] in _MECHANISMS:
        path = Path(tempfile.mkdtemp(prefix="lab-pair-")) / "mechanism.toml"
        path.write_text(_mechanism(pair, _MECHANISMS[robot["convention"]], tool), encoding="utf-8")
        return lab.load_robot(path)
    table = [
        [float(nominal[f"link{i + 1}.{column}"]) for column in ("theta", "d", "a", "alpha")] for i in range(len(slides))
    ]
    return lab.robot_from_dh(
        table,
        convention=robot["convention"],
        name=pair["name"],
        joint_unit="deg",
        prismatic=slides,
        limits=[joint["limits"] for joint in robot["joints"]],
        tool=tool,
    )


def _mechanism(pair: Mapping[str, Any], parts: Template, tool: Mapping[str, list[float]]) -> str:
    """Return a mechanism as TOML: its parts with the nominal values filled in, its joints and targets."""
    nominal = {name.replace(".", "_"): value for name, value in pair["nominal"].items()}
    lines = [f'name = "{pair["name"]}"', 'platform = "platform"', parts.substitute(nominal)]
    for i, joint in enumerate(pair["robot"]["joints"], start=1):
        unit = "m" if joint["type"] == "prismatic" else "deg"
        low, high = joint["limits"]
        lines += ["[[joint]]", f'name = "q{i}"', f'type = "{joint["type"]}"']
        lines += [f"lower_{unit} = {low}", f"upper_{unit} = {high}"]
    return "\n".join([*lines, "[tool]", *(f"{name} = {point}" for name, point in tool.items())]) + "\n"


def measured(pair: Mapping[str, Any], robot: Robot) -> Measurements:
    """Make the lab's measurements of a pair."""
    rows = pair["measurements"]
    missing = [math.nan] * 3
    points = [[missing if point is None else list(map(float, point)) for point in row] for row in rows["points"]]
    return lab.measurements(
        rows["joints"],
        points,
        robot=robot,
        joint_unit="deg",
        targets=pair["robot"]["targets"],
        sigma=rows["sigma_m"],
    )


def wishes(pair: Mapping[str, Any], robot: Robot) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the parameters to fix and to free, so that the lab fits those of the pair.

    Nothing is freed in a rank-deficient set: there the lab chooses among the free ones.

    Raises:
        LabError: the lab's robot has other parameters.
    """
    names, free = robot.parameter_names(pair["robot"]["targets"]), pair["free"]
    if names != tuple(name for name in pair["nominal"] if name in names) or len(names) < len(pair["nominal"]):
        raise LabError(f"{pair['name']}: the lab's parameters are {', '.join(names)}; mend the robot of the pair")
    return tuple(name for name in names if name not in free), tuple(free if "parameters" in pair["results"] else ())


def _identified(pair: Mapping[str, Any], robot: Robot, data: Measurements) -> Identification:
    fix, free = wishes(pair, robot)
    arm = robot.arm(tuple(pair["robot"]["targets"]))
    return identify(arm, data, arm.nominal(robot.tool), options=FitOptions(fix=fix, free=free, prior="off"))


def compared(pair: Mapping[str, Any]) -> Digits:
    """Identify a pair's robot with the lab, and count the digits that agree."""
    robot, reference = robot_of(pair), pair["results"]
    data = measured(pair, robot)
    found = _identified(pair, robot, data)
    arm, free = found.model, list(found.fit.free)
    seen = np.isfinite(found.residuals)
    residuals = _numbers(reference["residuals_m"])
    if (np.isfinite(residuals) != seen).any():
        raise LabError(f"{pair['name']}: residuals are missing at other points than measurements; mend the file")
    size = float(np.sqrt(np.mean(residuals[seen] ** 2)))
    exact = size < 1e-20  # no noise: residuals are compared with the points' own size
    sigma = np.where(np.isfinite(data.sigma_m), data.sigma_m, 1.0)[:, None, None]
    total, total_reference = np.nansum((found.residuals / sigma) ** 2), float(reference["sum_of_squares"])
    turning = np.array([joint["type"] != "prismatic" for joint in pair["robot"]["joints"]])
    ahead = np.array(pair["predict"], dtype=np.float64) * np.where(turning, np.pi / 180, 1.0)
    points, slopes = arm.observe(ahead, found.values)
    slopes = slopes[..., free]
    spread = slopes @ found.covariance @ np.swapaxes(slopes, -1, -2)
    points_reference = _numbers([[each["point_m"] for each in row] for row in reference["predicted"]])
    upper = np.triu_indices(3)
    spread_reference = _numbers([[each["covariance_m2"] for each in row] for row in reference["predicted"]])
    traces = spread_reference[..., [0, 3, 5]].sum(axis=-1)[..., None]
    parameters = covariance = None
    if "parameters" in reference:
        if (names := [arm.names[i] for i in free]) != pair["free"]:
            raise LabError(f"{pair['name']}: the lab fits {', '.join(names)}; the pair frees {', '.join(pair['free'])}")
        values = np.array([float(each) for each in reference["parameters"].values()])
        parameters = _agreement(found.values[free] - values, np.maximum(np.abs(values), LEAST_SIZE))
        covariance = _of_covariance(found.covariance, reference["covariance"])
    return Digits(
        parameters,
        _agreement((found.residuals - residuals)[seen], np.array(1.0 if exact else size)),
        MOST_DIGITS if exact else _agreement(total - total_reference, np.array(total_reference)),
        covariance,
        _agreement(points - points_reference, np.abs(points_reference).max()),
        _agreement((spread[..., *upper] - spread_reference), traces),
        (found.fit.rank, len(free)),
    )


def _of_covariance(found: Array, rows: Iterable[Iterable[str]]) -> float:
    reference = np.zeros_like(found)
    for i, row in enumerate(rows):
        reference[i, i:] = reference[i:, i] = list(map(float, row))
    std = np.sqrt(np.diag(reference))
    return _agreement(found - reference, np.outer(std, std))


def _numbers(texts: Any) -> Array:
    """Return decimals as an array; a point that is None as NaN."""

    def number(each: Any) -> Any:
        if each is None:
            return [math.nan] * 3
        return [number(one) for one in each] if isinstance(each, list) else float(each)

    return np.array(number(texts), dtype=np.float64)


def _agreement(difference: Any, size: Any) -> float:
    """Return the fewest correct digits: minus the logarithm of the largest relative error."""
    error = float(np.max(np.abs(difference) / size, initial=0.0))
    return MOST_DIGITS if error < 10**-MOST_DIGITS else max(-math.log10(error), 0.0)


def answer(options: Options) -> Answer:
    """Compare all sets of a folder."""
    paths = sorted(options.folder.glob("*.json"))
    pairs = [json.loads(path.read_text(encoding="utf-8")) for path in paths if path.name != "schema.json"]
    if not pairs:
        raise LabError(f"{options.folder}: holds no reference pairs; give their folder")
    values, rows = {}, []
    for pair in pairs:
        found = compared(pair)
        values[pair["name"]] = {**found.__dict__, "condition": float(pair["results"]["condition"])}
        numbers = (found.parameters, found.residuals, found.sum_of_squares, found.covariance, found.predicted)
        digits = ["-" if each is None else f"{each:.1f}" for each in (*numbers, found.predicted_covariance)]
        rank = f"{found.rank[0]} of {len(pair['free'])}"
        rows.append((pair["name"], rank, f"{float(pair['results']['condition']):.1e}", *digits))
    heads = (
        "set",
        "rank",
        "condition",
        "parameters",
        "residuals",
        "sum of squares",
        "covariance",
        "points",
        "their cov.",
    )
    return Answer(
        values, Document("Digits to which the lab agrees with the reference pairs", (Table(heads, tuple(rows)),))
    )


if __name__ == "__main__":
    run_script("reference_pairs_digits")
