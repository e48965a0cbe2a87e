from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from lab.calibration.estimate import Estimate
from lab.calibration.estimate_files import save_estimate
from lab.campaign.instruments import instrument
from lab.campaign.option_groups import Effects
from lab.campaign.options import DesignOptions, VirtualCampaign
from lab.campaign.robot import Robot, load_robot
from lab.commands.calibrate.load_run import load_estimate, load_run
from lab.commands.calibrate.options import MeasuredCampaign
from lab.commands.calibrate.result import CalibrationResult
from lab.commands.calibrate.run import MeasurementSession
from lab.commands.certify.result import Certificate
from lab.commands.compare import ComparisonResult
from lab.commands.compensate.options import CompensateOptions
from lab.commands.compensate.result import CompensationResult
from lab.commands.design.run import DesignResult, PlanCheckResult
from lab.commands.import_measurements.run import ImportResult
from lab.commands.inspect.run import Inspection
from lab.commands.measurements import (
    WorldFrames,
    measurements,
    read_measurements,
    robot_from_dh,
    world_frames,
    write_measurements,
)
from lab.commands.next.planner import PosePlanner
from lab.commands.next.run import NextPoseResult
from lab.commands.options import (
    CertifyOptions,
    CompareOptions,
    ImportOptions,
    InspectOptions,
    NextOptions,
    PredictOptions,
    StatusOptions,
    StudyOptions,
    TrendOptions,
    VerifyOptions,
)
from lab.commands.predict import PredictionResult
from lab.commands.result import Result
from lab.commands.status import StatusResult
from lab.commands.study.run import StudyResult
from lab.commands.trend import TrendResult
from lab.commands.verify import VerificationResult
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.extensions.dynamics.arm.result import DynamicsResult
from lab.extensions.dynamics.options import DynamicsOptions, PayloadOptions
from lab.extensions.dynamics.payload.result import PayloadResult
from lab.extensions.reproduction.options import ReproduceOptions
from lab.extensions.reproduction.result import ReproductionResult
from lab.extensions.robotics.kinematics.options import KinematicsOptions
from lab.extensions.robotics.kinematics.result import KinematicsResult
from lab.extensions.robotics.trajectory.options import TrajectoryOptions
from lab.extensions.robotics.trajectory.result import TrajectoryResult
from lab.extensions.robotics.workspace.options import WorkspaceOptions
from lab.extensions.robotics.workspace.result import WorkspaceResult
from lab.formats.target_csv import Targets
from lab.noise.instruments import Instrument
from lab.pose_selection.criteria import Criterion
from lab.studies.grid import Study

__all__ = [
    "CalibrationResult",
    "CompensationResult",
    "Criterion",
    "DesignResult",
    "Effects",
    "Estimate",
    "Inspection",
    "Instrument",
    "LabError",
    "MeasurementSession",
    "Measurements",
    "PayloadResult",
    "PosePlanner",
    "PredictionResult",
    "Result",
    "Robot",
    "StudyResult",
    "Targets",
    "VerificationResult",
    "WorldFrames",
    "__version__",
    "calibrate",
    "certify",
    "compare",
    "compensate",
    "design",
    "dynamics",
    "identify",
    "import_measurements",
    "inspect",
    "instrument",
    "load_estimate",
    "load_robot",
    "load_run",
    "measurements",
    "next_pose",
    "payload",
    "predict",
    "read_measurements",
    "reproduce",
    "robot_from_dh",
    "save_estimate",
    "simulate",
    "solve_kinematics",
    "status",
    "study",
    "trajectory",
    "trend",
    "verify",
    "workspace",
    "world_frames",
    "write_measurements",
]

__version__: str

def calibrate(
    robot: str | Path | Robot | VirtualCampaign = "irb120",
    *,
    cell: str | Path | None = None,
    poses: int = 50,
    plan: str | Path | None = None,
    seed: int = 0,
    targets: Sequence[str] = ...,
    instrument: str | Path | Instrument = "uniform-8um",
    observe: str = "points",
    readings: int = 1,
    noise_mm: float | None = None,
    position_sigma_mm: float = 0.5,
    rotation_sigma_mrad: float = 1.5,
    offset_sigma_mrad: float = 0.0,
    dh_only: bool = False,
    gate_mm: float | None = None,
    region: str = "measured",
    require: Literal["good"] | None = None,
    date: str | None = None,
    serial: str | None = None,
    no_recording: bool = False,
    model: str = "geometric",
    robust: bool = False,
    fix: Sequence[str] = ...,
    free: Sequence[str] = ...,
    prior: Literal["auto", "on", "off"] = "auto",
    tolerance_mm: float = 0.5,
    tolerance_mrad: float = 1.5,
    load: str | Path | None = None,
    accept_edited: bool = False,
    effects: Effects | None = None,
    occlusion: bool = False,
    orientation_share: float = 1.0,
    fixtures: int = 4,
    orientation: Literal["intrinsic-xyz", "fixed-xyz", "rotation-vector"] | None = None,
    noise_mrad: float | None = None,
    method: Literal["global", "sequential"] = "global",
    socket_distance_mm: float | None = None,
) -> CalibrationResult: ...
def certify(
    run: str | Path | CertifyOptions,
    *,
    details: str | Path | None = None,
    instrument: str | Path | Instrument | None = None,
    tolerance_mm: float | None = None,
    statistic: Literal["mean", "p95", "max"] = "mean",
    decision_rule: Literal["guard-band", "simple"] = "guard-band",
    force: bool = False,
    accept_edited: bool = False,
) -> Certificate: ...
def compare(
    runs: Sequence[str | Path | CalibrationResult] | CompareOptions,
    *,
    force: bool = False,
    accept_edited: bool = False,
) -> ComparisonResult: ...
def compensate(
    targets: str | Path | Targets | CompensateOptions | None = None,
    run: str | Path | CalibrationResult | None = None,
    *,
    program: str | Path | None = None,
    orientation: Literal["intrinsic-xyz", "fixed-xyz", "rotation-vector"] | None = None,
    force: bool = False,
    accept_edited: bool = False,
    cell: str | Path | None = None,
    controller: Literal["fanuc", "jbi", "krl", "rapid", "urscript", "val3"] | None = None,
    no_check: bool = False,
    load: str | Path | None = None,
    frames: str = "",
    pulses_per_deg: Sequence[float] = ...,
    require: Literal["good"] | None = None,
    no_recording: bool = False,
    digits: int | None = None,
) -> CompensationResult: ...
def design(
    robot: str | Path | Robot | DesignOptions = "irb120",
    *,
    cell: str | Path | None = None,
    poses: int | None = None,
    accuracy_mm: float | None = None,
    criterion: str | Criterion = "O1",
    scaling: Literal["raw", "unit", "length", "whitened"] = "whitened",
    targets: Sequence[str] = ...,
    instrument: str | Path | Instrument = "uniform-8um",
    candidates: int = 2000,
    starts: int = 4,
    curve: bool = False,
    check: str | Path | None = None,
    extend: str | Path | None = None,
    home: Sequence[float] = ...,
    reference_every: int | None = None,
    controller: Literal["fanuc", "jbi", "krl", "rapid", "urscript", "val3"] | None = None,
    clearance_mm: float = 20.0,
    self_clearance_mm: float = 20.0,
    no_check: bool = False,
    no_recording: bool = False,
    seed: int = 0,
) -> DesignResult | PlanCheckResult: ...
def dynamics(
    file: str | Path | DynamicsOptions | None = None,
    robot: str | Path | Robot | None = None,
    *,
    drives: str | Path | None = None,
    sensor: str | Path | None = None,
    load: str | Path | None = None,
    validate: str | Path | Measurements | None = None,
    holdout: float = 0.0,
    without: Sequence[str] = ...,
    delay: bool = False,
    physical: bool = False,
    band_hz: float = 20.0,
    serial: str | None = None,
    no_recording: bool = False,
    simulate: bool = False,
    seed: int = 0,
    seconds: float = 10.0,
    rate_hz: float = 500.0,
    noise_percent: float = 0.5,
    friction_percent: float = 5.0,
    motor_inertia_kgm2: float = 0.05,
    lag_ms: float = 0.0,
    filter_hz: float = 0.0,
    base_tilt_deg: Sequence[float] = ...,
    payload_kg: float | None = None,
    payload_mm: Sequence[float] = ...,
    rounds: int = 1,
) -> DynamicsResult: ...
def identify(
    measurements: str | Path | Measurements | MeasuredCampaign,
    robot: str | Path | Robot | None = None,
    *,
    cell: str | Path | None = None,
    seed: int = 0,
    instrument: str | Path | Instrument | None = None,
    noise_mm: float | None = None,
    holdout: float | None = None,
    holdout_last: float | None = None,
    validate: str | Path | Measurements | None = None,
    refit: Sequence[str] = ...,
    gate_mm: float | None = None,
    region: str = "measured",
    require: Literal["good"] | None = None,
    date: str | None = None,
    serial: str | None = None,
    no_recording: bool = False,
    observe: str = "points",
    orientation: Literal["intrinsic-xyz", "fixed-xyz", "rotation-vector"] | None = None,
    noise_mrad: float | None = None,
    method: Literal["global", "sequential"] = "global",
    socket_distance_mm: float | None = None,
    model: str = "geometric",
    robust: bool = False,
    fix: Sequence[str] = ...,
    free: Sequence[str] = ...,
    prior: Literal["auto", "on", "off"] = "auto",
    tolerance_mm: float = 0.5,
    tolerance_mrad: float = 1.5,
    load: str | Path | None = None,
    accept_edited: bool = False,
) -> CalibrationResult: ...
def import_measurements(
    points: str | Path | ImportOptions,
    robot: str | Path | Robot | None = None,
    *,
    joints: str | Path,
    by: Literal["auto", "name", "order", "time"] = "auto",
    targets: Sequence[str] = ...,
    unit: Literal["mm", "m", "in"] | None = None,
    joint_unit: Literal["deg", "rad"] | None = None,
    coverage: float = 1.0,
    columns: str | Path | None = None,
    clock_offset_s: float | None = None,
    clock_drift_ppm: float = 0.0,
    still_deg_s: float = 0.1,
    settled_s: float = 0.5,
    station: str | None = None,
) -> ImportResult: ...
def inspect(
    robot: str | Path | Robot | InspectOptions = "irb120",
    *,
    cell: str | Path | None = None,
    targets: Sequence[str] = ...,
    tool_mm: Sequence[float] = ...,
    model: str = "geometric",
    fix: Sequence[str] = ...,
    free: Sequence[str] = ...,
) -> Inspection: ...
def next_pose(
    plan: str | Path | DesignResult | NextOptions,
    measurements: str | Path | Measurements | None = None,
    *,
    accuracy_mm: float | None = None,
    criterion: str | Criterion = "I",
    instrument: str | Path | Instrument | None = None,
    follow: bool = False,
    patience_s: float = 600.0,
    connect: str | None = None,
    candidates: int = 2000,
    no_recording: bool = False,
    seed: int = 0,
) -> NextPoseResult: ...
def payload(
    file: str | Path | PayloadOptions | None = None,
    robot: str | Path | Robot | None = None,
    run: CalibrationResult | str | Path | None = None,
    *,
    cell: str | Path | None = None,
    sensor: str | Path | None = None,
    accept_edited: bool = False,
    method: Literal["torques", "wrench"] | None = None,
    friction: bool = False,
    delay: bool = False,
    tilt: bool = False,
    turn: bool = False,
    physical: bool = False,
    stiffness_nm_per_rad: float = 100000.0,
    serial: str | None = None,
    no_recording: bool = False,
    simulate: bool = False,
    seed: int = 0,
    seconds: float = 10.0,
    rate_hz: float = 500.0,
    noise_percent: float = 0.5,
    friction_percent: float = 5.0,
    motor_inertia_kgm2: float = 0.05,
    lag_ms: float = 0.0,
    filter_hz: float = 0.0,
    base_tilt_deg: Sequence[float] = ...,
    payload_kg: float | None = None,
    payload_mm: Sequence[float] = ...,
    rounds: int = 1,
) -> PayloadResult: ...
def predict(
    joints: str | Path | Measurements | Array | Sequence[Sequence[float]] | PredictOptions,
    run: str | Path | CalibrationResult | None = None,
    conditions: Mapping[str, Any] | None = None,
    *,
    force: bool = False,
    accept_edited: bool = False,
    load: str | Path | None = None,
) -> PredictionResult: ...
def reproduce(
    source: str | ReproduceOptions,
    *,
    exercise: bool = False,
    mark: str | Path | None = None,
) -> ReproductionResult: ...
def simulate(
    robot: str | Path | Robot | VirtualCampaign = "irb120",
    *,
    cell: str | Path | None = None,
    poses: int = 50,
    plan: str | Path | None = None,
    seed: int = 0,
    targets: Sequence[str] = ...,
    instrument: str | Path | Instrument = "uniform-8um",
    observe: str = "points",
    readings: int = 1,
    position_sigma_mm: float = 0.5,
    rotation_sigma_mrad: float = 1.5,
    offset_sigma_mrad: float = 0.0,
    dh_only: bool = False,
    load: str | Path | None = None,
    accept_edited: bool = False,
    effects: Effects | None = None,
    occlusion: bool = False,
    orientation_share: float = 1.0,
    fixtures: int = 4,
    orientation: Literal["intrinsic-xyz", "fixed-xyz", "rotation-vector"] | None = None,
    socket_distance_mm: float | None = None,
) -> MeasurementSession: ...
def solve_kinematics(
    robot: str | Path | Robot | KinematicsOptions = "irb120",
    *,
    joints: Sequence[float] = ...,
    pose: Sequence[float] = ...,
    file: str | Path | None = None,
    orientation: Literal["intrinsic-xyz", "fixed-xyz", "rotation-vector"] | None = None,
    of: Sequence[str] = ...,
    tool_mm: Sequence[float] = ...,
    rates: Sequence[float] = ...,
    twist: Sequence[float] = ...,
    frame: Literal["base", "tool"] = "base",
    matrices: bool = False,
    between: tuple[int, int] | None = None,
    symbolic: bool = False,
    no_recording: bool = False,
    out: str | Path | None = None,
    overwrite: bool = False,
) -> KinematicsResult: ...
def status(
    folder: str | Path | StatusOptions,
    *,
    every_days: int = 35,
    on: str | None = None,
    require: Literal["good"] | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
) -> StatusResult: ...
def study(
    config: str | Path | Study | StudyOptions,
    *,
    out: str | Path | None = None,
    resume: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
) -> StudyResult: ...
def trajectory(
    points: str | Path | TrajectoryOptions,
    run: CalibrationResult | str | Path | None = None,
    *,
    robot: str | Path | Robot | None = None,
    law: Literal["common", "own", "independent"] = "common",
    blend_mm: float | None = None,
    blend_deg: float | None = None,
    speeds: Sequence[float] = ...,
    accelerations: Sequence[float] = ...,
    jerks: Sequence[float] = ...,
    feed_mm_s: float = 250.0,
    feed_mm_s2: float = 2000.0,
    turn_deg_s: float = 90.0,
    orientation: Literal["intrinsic-xyz", "fixed-xyz", "rotation-vector"] | None = None,
    tool_mm: Sequence[float] = ...,
    step_ms: float = 10.0,
    cell: str | Path | None = None,
    no_check: bool = False,
    controller: Literal["fanuc", "jbi", "krl", "rapid", "urscript", "val3"] | None = None,
    payload_kg: float | None = None,
    load: str | Path | None = None,
    no_recording: bool = False,
    force: bool = False,
    accept_edited: bool = False,
) -> TrajectoryResult: ...
def trend(
    folder: str | Path | TrendOptions,
    *,
    kept: Sequence[str] = ...,
    serial: str | None = None,
    force: bool = False,
    accept_edited: bool = False,
) -> TrendResult: ...
def verify(
    run: str | Path | CalibrationResult | VerifyOptions,
    measurements: str | Path | Measurements | None = None,
    *,
    refit: Sequence[str] = ...,
    instrument: str | Path | Instrument | None = None,
    noise_mm: float | None = None,
    serial: str | None = None,
    date: str | None = None,
    require: Literal["good"] | None = None,
    no_recording: bool = False,
    force: bool = False,
    accept_edited: bool = False,
) -> VerificationResult: ...
def workspace(
    robots: str | Path | Robot | Sequence[str | Robot] | WorkspaceOptions = ...,
    *,
    cell: str | Path | None = None,
    tool_mm: Sequence[float] = ...,
    places: int | None = None,
    orientations: int = 60,
    level_mm: float | None = None,
    seed: int = 0,
    no_recording: bool = False,
    out: str | Path | None = None,
    overwrite: bool = False,
) -> WorkspaceResult: ...
