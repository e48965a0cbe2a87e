"""An estimate as files of a run's folder: one function writes them, one reads them, of the current schema.

``parameters.json`` has a row for each parameter, ``covariance.csv`` the covariance of the identified ones,
``result.json`` the noise and the measured range, ``fitted_poses.csv`` the fitted joint positions, and ``residual.csv``
the joints' offsets that no group explains.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lab.calibration.residual.gaussian_process import COMPONENTS, GROUP, JointProcess
from lab.core.errors import LabError, error_context
from lab.core.limits import LENGTH_M, NUMBER_SIZE
from lab.core.linear_model import refuse_impossible_covariance
from lab.core.se3 import Array
from lab.core.units import MM, MRAD, joints_to_si
from lab.formats.csv_table import CsvTable, write_columns
from lab.formats.noise_model import (
    NoiseModel,
    component_errors_of,
    noise_model_from_dict,
    noise_model_to_dict,
)
from lab.formats.structured import read_structured, unstructured
from lab.kinematics.effects.effect_registry import CAMPAIGN_SPECIFIC
from lab.kinematics.joints import JointSpec
from lab.prediction.estimate import CarriedLoad, Estimate, EstimatedParameter, NominalArm
from lab.prediction.estimate_of_fit import in_another_session
from lab.prediction.extrapolation import MeasuredRange, PoseCover

__all__ = [
    "COVARIANCE_FILE",
    "PARAMETERS_FILE",
    "POSES_FILE",
    "RESIDUAL_FILE",
    "RESULT_FILE",
    "Extrapolation",
    "ResidualSizes",
    "measured_range_from_dict",
    "measured_range_to_dict",
    "read_cover",
    "read_estimate",
    "read_residual",
    "residual_columns",
    "residual_to_dict",
    "save_estimate",
    "write_cover",
    "write_estimate",
    "write_residual",
]

PARAMETERS_FILE, COVARIANCE_FILE, RESULT_FILE = "parameters.json", "covariance.csv", "result.json"
RESIDUAL_FILE, POSES_FILE = "residual.csv", "fitted_poses.csv"
_RANGE_KEYS = ("lower", "upper", "edge")
_CONVERTED = "converted"  # status of rows of the same arm in other parameters
_MEND = "give the folder of a run of lab calibrate or lab identify, or make the run again"


@dataclass(frozen=True)
class ResidualSizes:
    """Sizes of the process as ``result.json`` holds them; its keys."""

    p: float
    variances: Mapping[str, float]
    upper_quartiles: Mapping[str, float]
    variance_errors: Sequence[Sequence[float]]
    bound_factor: float = 1.0

    def __post_init__(self) -> None:
        """Refuse a set without some component, or with a variance below zero, with a LabError."""
        for name in ("variances", "upper_quartiles"):
            sizes = getattr(self, name)
            if missing := [each for each in COMPONENTS if each not in sizes]:
                raise LabError(f"residual.{name}: '{missing[0]}' is missing")
            if min(sizes.values()) < 0:
                raise LabError(f"residual.{name}: a variance is not below zero")
        if not self.bound_factor > 0:
            raise LabError("residual.bound_factor: a factor of variances is above zero")
        if np.shape(self.variance_errors) != (len(COMPONENTS),) * 2:
            raise LabError(f"residual.variance_errors: not {len(COMPONENTS)} rows of {len(COMPONENTS)} numbers")

    @property
    def errors(self) -> Array:
        """Covariance ``(c, c)`` of the variances."""
        return np.array(self.variance_errors)


@dataclass(frozen=True)
class Extrapolation:
    """Model discrepancy beyond the measured positions, by the keys of ``result.json``."""

    growth_mrad: float | None = None
    unsure_mrad: float | None = None

    def __post_init__(self) -> None:
        """Refuse a size below zero, with a LabError."""
        if min(self.growth_mrad or 0.0, self.unsure_mrad or 0.0) < 0:
            raise LabError("extrapolation: growth_mrad and unsure_mrad are to be numbers of zero or more")


@dataclass(frozen=True)
class _ActingPrior:
    acts_in: int


@dataclass(frozen=True)
class _SavedEstimate:
    """The part of ``result.json`` that an estimate is made from; its keys.

    Attributes:
        cluster_robust: whether the parameters' covariance is that of whole poses' own residuals.
        noise_model: errors beside the instrument's; None where there are none.
        noise_tail_freedom: degrees of freedom of the noise's tails, of Student's t; None where it is Gaussian.
        measured_range: the joint positions that were fitted; None where they are not known.
        extrapolation: what the model may lack where nothing was measured; None likewise.
        residual: sizes of the joints' offsets that no group explains; None where they were not fitted.
    """

    model: str
    noise_known: bool
    noise_mm: float | None
    residual_mm: float | None
    freedom: int
    adequate: bool | None
    cluster_robust: bool = False
    noise_model: NoiseModel | None = None
    noise_tail_freedom: float | None = None
    measured_range: Mapping[str, Mapping[str, float]] | None = None
    extrapolation: Extrapolation | None = None
    residual: ResidualSizes | None = None
    prior: _ActingPrior | None = None

    def __post_init__(self) -> None:
        """Refuse sizes below zero, with a LabError."""
        for name in ("noise_mm", "residual_mm"):
            if (size := getattr(self, name)) is not None and not size >= 0:
                raise LabError(f"{name} is {size:g}; a standard deviation is not below zero")
        if self.freedom < 0:
            raise LabError(f"freedom is {self.freedom}; degrees of freedom are not below zero")
        if self.noise_tail_freedom is not None and not self.noise_tail_freedom > 2:
            raise LabError(f"noise_tail_freedom is {self.noise_tail_freedom:g}; Student's t has a variance above 2")


class _EstimateFiles(NamedTuple):
    """The content of an estimate's files, before a robot is at hand.

    Attributes:
        rows: every row of ``parameters.json``, also of the same arm in other parameters.
        identified: the parameters that ``covariance`` ``(f, f)`` is of.
    """

    content: _SavedEstimate
    rows: tuple[EstimatedParameter, ...]
    identified: tuple[str, ...]
    covariance: Array


def save_estimate(estimate: Estimate, folder: str | Path) -> None:
    """Write an estimate into a folder, which is created; ``lab.load_estimate(folder, robot)`` reads it.

    Args:
        estimate: of a result (``result.estimate``), or loaded.
        folder: to write into; files of an earlier estimate are replaced.

    Raises:
        OSError: the folder or a file cannot be written.

    Example:
        >>> import lab, pathlib, tempfile
        >>> estimate = lab.calibrate("irb120", seed=7).estimate
        >>> folder = pathlib.Path(tempfile.mkdtemp())
        >>> lab.save_estimate(estimate, folder)
        >>> bool((lab.load_estimate(folder, "irb120").covariance == estimate.covariance).all())
        True
    """
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    write_estimate(place, estimate)
    _write_json(place / RESULT_FILE, _estimate_to_dict(estimate))


def write_estimate(folder: Path, estimate: Estimate, converted: Sequence[Mapping[str, Any]] = ()) -> None:
    """Write the files of an estimate but ``result.json`` into a folder that is there.

    Args:
        converted: further rows of ``parameters.json``, the same arm in other parameters.
    """
    _write_json(folder / PARAMETERS_FILE, [*map(unstructured, estimate.rows), *converted])
    table = (
        [name, *map(repr, row)] for name, row in zip(estimate.identified, estimate.covariance.tolist(), strict=True)
    )
    lines = [",".join(row) for row in [["parameter", *estimate.identified], *table]]
    (folder / COVARIANCE_FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")
    chain = estimate.rigid.chain
    if estimate.process is not None:
        columns = residual_columns(chain, estimate.arm.conditions, estimate.arm.targets)
        write_residual(folder / RESIDUAL_FILE, estimate.process, columns)
    if estimate.measured is not None and estimate.measured.cover is not None:
        write_cover(folder / POSES_FILE, estimate.measured.cover, chain)


def read_estimate(folder: Path, robot: NominalArm, load: CarriedLoad | None = None) -> Estimate:
    """Read an estimate from the folder of a run.

    Raises:
        LabError: a file is missing, does not hold what a run writes, or is of another robot.
    """
    files = _read_estimate_files(folder)
    rows = tuple(row for row in files.rows if row.status != _CONVERTED)
    saved, names = files.content, [row.name for row in rows]
    targets = _targets(folder, names)
    groups = [name for name in saved.model.split("+") if name != "geometric"]
    estimate = Estimate(
        rigid=robot.arm(targets),
        loads=robot.loads,
        effects=tuple(name for name in groups if name not in (*CAMPAIGN_SPECIFIC, GROUP)),
        left_out=tuple(name for name in groups if name in CAMPAIGN_SPECIFIC),
        rows=rows,
        identified=files.identified,
        covariance=files.covariance,
        noise_m=MM.to_si(saved.noise_mm or 0.0),
        residual_m=MM.to_si(saved.residual_mm or 0.0),
        noise_known=saved.noise_known,
        dof=saved.freedom,
        adequate=saved.adequate,
        cluster_robust=saved.cluster_robust,
        tail_dof=saved.noise_tail_freedom,
        load=load,
        prior_acts_in=None if saved.prior is None else saved.prior.acts_in,
    )
    if GROUP in groups:
        process = read_residual(folder, saved.residual, robot.chain, estimate.arm.conditions, targets)
        estimate = replace(estimate, process=process)
    if missing := [name for name in estimate.arm.names if name not in names]:
        raise LabError(f"{folder}/{PARAMETERS_FILE}: has no {missing[0]}: it is of another robot, or was cut short")
    return _with_saved_errors(estimate, saved, folder, robot.chain)


def _targets(folder: Path, names: Sequence[str]) -> tuple[str, ...]:
    """Return the targets that parameters of these names locate, at least one."""
    coordinates = [name for name in names if name.startswith("tool.") and name.endswith(".x")]
    if not coordinates:
        raise LabError(f"{folder}/{PARAMETERS_FILE}: has no tool (tool.p1.x…); identify again")
    return tuple(name.removeprefix("tool.").removesuffix(".x") for name in coordinates)


def _with_saved_errors(estimate: Estimate, saved: _SavedEstimate, folder: Path, chain: JointSpec) -> Estimate:
    """Return an estimate with its measured range, its noise model and how well that is known."""
    cover = read_cover(folder, chain)
    with error_context(folder / RESULT_FILE):
        measured = measured_range_from_dict(saved.measured_range, saved.extrapolation, chain, cover)
        shared = noise_model_from_dict(saved.noise_model, {})
        component_errors = component_errors_of(saved.noise_model)
    estimate = replace(estimate, measured=measured, component_errors=component_errors)
    return estimate if shared is None else replace(estimate, shared=in_another_session(shared, estimate))


def _read_estimate_files(folder: Path) -> _EstimateFiles:
    """Read the files of a run's folder that an estimate is made from.

    Raises:
        LabError: one is missing, or does not hold what a run writes.
    """
    content = read_structured(folder / RESULT_FILE, _SavedEstimate, _MEND)
    path = folder / PARAMETERS_FILE
    rows = read_structured(path, tuple[EstimatedParameter, ...], _MEND)
    for row in rows:
        for key in ("nominal", "exported", "estimate"):
            if abs(value := getattr(row, key)) not in LENGTH_M:
                text = f"{row.name}: {key} is {value:g}; no parameter is larger than {LENGTH_M.most:g}"
                raise LabError(f"{path}: does not hold what the lab writes: {text}; {_MEND}")
    return _EstimateFiles(content, rows, *_read_covariance(folder / COVARIANCE_FILE))


def _estimate_to_dict(estimate: Estimate) -> dict[str, Any]:
    """Return the part of ``result.json`` that an estimate is made from (``_SavedEstimate``)."""
    measured, process = estimate.measured, estimate.process
    return {
        "model": "+".join(("geometric", *estimate.effects, *estimate.left_out, *[GROUP] * (process is not None))),
        "noise_known": estimate.noise_known,
        "noise_mm": MM.of(estimate.noise_m),
        "residual_mm": MM.of(estimate.residual_m),
        "freedom": estimate.dof,
        "adequate": estimate.adequate,
        "cluster_robust": estimate.cluster_robust,
        "noise_model": noise_model_to_dict(estimate.shared, estimate.component_errors),
        "noise_tail_freedom": estimate.tail_dof,
        "measured_range": measured_range_to_dict(measured, estimate.rigid.chain),
        "extrapolation": None
        if measured is None
        else {"growth_mrad": MRAD.of(measured.growth), "unsure_mrad": MRAD.of(measured.unsure)},
        "residual": residual_to_dict(process),
        "prior": None if estimate.prior_acts_in is None else {"acts_in": estimate.prior_acts_in},
    }


def _write_json(path: Path, content: Any) -> None:
    text = json.dumps(content, indent=1, default=str, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def _read_covariance(path: Path) -> tuple[tuple[str, ...], Array]:
    if not path.is_file():
        raise LabError(f"{path}: is missing; make the run again")
    table = CsvTable(path)
    labels = table.texts("parameter")
    if labels is None or tuple(table.header[1:]) != labels:
        raise LabError(f"{path}: rows and columns name different parameters; identify again")
    try:
        matrix = np.array([table.texts(name) for name in labels], dtype=np.float64).T
    except ValueError as error:
        raise LabError(f"{path}: {error}; identify again") from error
    refuse_impossible_covariance(path, matrix)
    return labels, matrix


def residual_to_dict(process: JointProcess | None) -> dict[str, Any] | None:
    """Return the sizes of a process as ``result.json`` holds them, variances in SI units; None where there is none."""
    if process is None:
        return None
    return {
        "poses": len(process.inputs),
        "p": process.p,
        "noise_mm": MM.of(process.noise_m),
        "joint_scatter_mrad": MRAD.of(process.scatter_rad),
        "variances": dict(zip(COMPONENTS, process.variances.tolist(), strict=True)),
        "upper_quartiles": dict(zip(COMPONENTS, process.upper.tolist(), strict=True)),
        "variance_errors": process.errors.tolist(),
        "bound_factor": process.factor,
    }


def write_residual(path: Path, process: JointProcess, columns: Sequence[str]) -> None:
    """Write a row for each pose that the offsets come from: inputs, which targets were seen, joints' weights; SI.

    Args:
        columns: names of the inputs, then of the targets, then of the joints.
    """
    rows = np.concatenate([process.inputs, process.seen, process.weights], axis=1)
    write_columns(path, {name: list(map(repr, column.tolist())) for name, column in zip(columns, rows.T, strict=True)})


def residual_columns(chain: JointSpec, conditions: Sequence[str], targets: Sequence[str]) -> list[str]:
    """Return the names of the columns of ``residual.csv``."""
    joints = [f"position_{name}" for name in chain.joint_names]
    return [*joints, *conditions, *(f"seen_{name}" for name in targets), *(f"weight_{n}" for n in chain.joint_names)]


def read_residual(
    folder: Path,
    found: ResidualSizes | None,
    chain: JointSpec,
    conditions: Sequence[str],
    targets: Sequence[str],
) -> JointProcess:
    """Read the process of a run.

    Args:
        found: its sizes; None where ``result.json`` has none.

    Raises:
        LabError: a file does not hold what a run writes.
    """
    path = folder / RESIDUAL_FILE
    try:
        if found is None:
            raise LabError(f"has no {GROUP}, which the model has")
        table = CsvTable(path)
        names = residual_columns(chain, conditions, targets)
        if tuple(table.header) != tuple(names):
            raise LabError(f"{RESIDUAL_FILE}: its columns are not {', '.join(names)}")
        rows = np.array([table.texts(name) for name in names], dtype=np.float64).T
    except (LabError, ValueError) as error:
        raise LabError(f"{folder}: {error}; run lab calibrate or lab identify again") from error
    if not (np.abs(rows) <= NUMBER_SIZE.most).all():
        raise LabError(f"{path}: has impossible numbers; run lab calibrate or lab identify again")
    size, first = chain.size, chain.size + len(conditions)
    seen = rows[:, first : first + len(targets)] > 0
    turning = ~np.array(chain.prismatic, dtype=np.bool_)
    likely = np.array([found.variances.get(name, 0.0) for name in COMPONENTS])
    inputs, weights = map(np.ascontiguousarray, (rows[:, :first], rows[:, -size:]))  # as in memory: sums round alike
    return JointProcess(inputs, seen, likely, found.errors, weights, turning, found.p, found.bound_factor)


def measured_range_to_dict(measured: MeasuredRange | None, chain: JointSpec) -> dict[str, Any] | None:
    """Return limits, width of the edges (deg, mm of a slide) and slope by joint; None where unknown."""
    if measured is None:
        return None
    found = {}
    for i, name in enumerate(chain.joint_names):
        unit, factor = _unit(chain.prismatic[i])
        sizes = zip(_RANGE_KEYS, (measured.lower[i], measured.upper[i], measured.edge[i]), strict=True)
        found[name] = {f"{key}_{unit}": float(size / factor) for key, size in sizes} | {
            "slope_beyond": float(measured.slope[i])
        }
    return found


def measured_range_from_dict(
    content: Mapping[str, Mapping[str, float]] | None,
    extrapolation: Extrapolation | None,
    chain: JointSpec,
    cover: PoseCover | None = None,
) -> MeasuredRange | None:
    """Return the range that ``measured_range_to_dict`` made; None where it made none.

    Args:
        cover: the fitted poses; None where the run keeps none.

    Raises:
        LabError: it lacks a joint or a number, or limits are the wrong way round.
    """
    if content is None:
        return None
    rows = [
        _row(name, content.get(name), *_unit(slides))
        for name, slides in zip(chain.joint_names, chain.prismatic, strict=True)
    ]
    lower, upper, edge, slope = np.array(rows).T
    discrepancy = Extrapolation() if extrapolation is None else extrapolation
    growth, unsure = (MRAD.to_si(size) for size in (discrepancy.growth_mrad or 0.0, discrepancy.unsure_mrad or 0.0))
    turning = ~np.array(chain.prismatic, dtype=np.bool_)
    return MeasuredRange(lower, upper, turning, edge, slope, growth, unsure, cover)


def write_cover(path: Path, cover: PoseCover, chain: JointSpec) -> None:
    """Write a row for each distinct fitted pose, of very many some: joint positions, deg (mm of a slide)."""
    factors = joints_to_si(np.ones(chain.size), chain.prismatic)
    values = zip(chain.column_names, (cover.poses / factors).T.tolist(), strict=True)
    write_columns(path, {name: [f"{value:.9g}" for value in column] for name, column in values})


def read_cover(folder: Path, chain: JointSpec) -> PoseCover | None:
    """Read the poses that a run fitted; None of a run that stores none.

    Raises:
        LabError: the file does not hold what a run writes.
    """
    path = folder / POSES_FILE
    if not path.is_file():
        return None
    table = CsvTable(path)
    for column in chain.column_names:
        if table.texts(column) is None:
            raise LabError(f"{path}: has no column {column}; run lab calibrate or lab identify again")
    poses = joints_to_si(np.stack([table.numbers(each) for each in chain.column_names], axis=1), chain.prismatic)
    return PoseCover.of(poses, ~np.array(chain.prismatic, dtype=np.bool_))


def _row(joint: str, content: Mapping[str, float] | None, unit: str, factor: float) -> list[float]:
    """Lower and upper limit, width of the edges (rad or m) and slope of one joint."""
    names = [*(f"{key}_{unit}" for key in _RANGE_KEYS), "slope_beyond"]
    if missing := [name for name in names if name not in (content or {})]:
        raise LabError(f"measured_range: '{joint}.{missing[0]}' is missing")
    assert content is not None
    lower, upper, edge, slope = (content[name] for name in names)
    if not (lower <= upper and edge >= 0 and slope >= 0):
        raise LabError(f"measured_range.{joint}: needs lower <= upper, and an edge and a slope of zero or more")
    return [factor * lower, factor * upper, factor * edge, slope]


def _unit(slides: bool) -> tuple[str, float]:
    return ("mm", 1e-3) if slides else ("deg", np.pi / 180)
