"""Plan, run and judge the calibration of a robot: on a virtual robot before the session, then on the real one.

Frames and units: lengths are in m and angles in rad, unless a name ends in another unit. Measured points, identified
parameters and corrected targets are in the instrument's frame, in which the robot was measured; ``world_frames`` says
where that is, and where the robot's base is, in the world of the MuJoCo model. ``T_a_b`` is the pose of b in a.

Example:
    >>> import lab
    >>> day = lab.simulate("irb120", poses=50, seed=7)  # a robot that is off, and an instrument that measures it
    >>> result = lab.identify(day.measurements, robot="irb120", instrument="uniform-8um")
    >>> result.to_dict()["verdict"]
    'good'
    >>> print(result.summary())  # doctest: +SKIP
    >>> result.report("report.html")  # doctest: +SKIP
"""

from difflib import get_close_matches
from importlib import import_module

from lab.core.version import __version__

__all__ = [
    "CalibrationResult",
    "CompensationResult",
    "Criterion",
    "DesignResult",
    "DesignTask",
    "Effects",
    "Estimate",
    "EstimationProblem",
    "Estimator",
    "Event",
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
    "Sampler",
    "Sensor",
    "StudyResult",
    "Targets",
    "VerificationResult",
    "WorldFrames",
    "__version__",
    "calibrate",
    "certify",
    "check_plan",
    "compensate",
    "convert_rotation",
    "design",
    "dynamics",
    "example",
    "fit",
    "history",
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
    "plan_touches",
    "predict",
    "read_measurements",
    "reproduce",
    "robot_from_dh",
    "save_estimate",
    "simulate",
    "solve_kinematics",
    "study",
    "trajectory",
    "verify",
    "verify_touches",
    "workspace",
    "world_frames",
    "write_measurements",
]

_MODULES = {  # where each name is, imported when it is asked for
    "lab.prediction.estimate": ("Estimate",),
    "lab.prediction.estimate_files": ("save_estimate",),
    "lab.calibration.estimator": ("EstimationProblem", "Estimator"),
    "lab.options.named_instruments": ("instrument",),
    "lab.options.option_groups": ("Effects",),
    "lab.robots.load_robot": ("load_robot",),
    "lab.robots.robot": ("Robot",),
    "lab.library.load_run": ("load_estimate", "load_run"),
    "lab.library.calibration_result": ("CalibrationResult",),
    "lab.library.calibrate": ("calibrate",),
    "lab.library.fit": ("fit",),
    "lab.library.identify": ("identify",),
    "lab.library.simulate": ("MeasurementSession", "simulate"),
    "lab.library.certify": ("certify",),
    "lab.library.compensation_result": ("CompensationResult",),
    "lab.library.compensate": ("compensate",),
    "lab.library.design": ("DesignResult", "design"),
    "lab.library.plan_check": ("check_plan",),
    "lab.library.example": ("example",),
    "lab.arm_history.history": ("history",),
    "lab.library.import_measurements": ("import_measurements",),
    "lab.library.inspect": ("Inspection", "inspect"),
    "lab.library.given_measurements": (
        "WorldFrames",
        "measurements",
        "read_measurements",
        "robot_from_dh",
        "world_frames",
        "write_measurements",
    ),
    "lab.library.pose_planner": ("PosePlanner",),
    "lab.library.next_pose": ("next_pose",),
    "lab.library.predict": ("PredictionResult", "predict"),
    "lab.library.result": ("Result",),
    "lab.studies.study": ("StudyResult", "study"),
    "lab.library.point_verification": ("VerificationResult",),
    "lab.library.verify": ("plan_touches", "verify", "verify_touches"),
    "lab.core.errors": ("LabError",),
    "lab.core.progress": ("Event",),
    "lab.core.measurements": ("Measurements",),
    "lab.formats.target_csv": ("Targets",),
    "lab.noise.instruments": ("Instrument",),
    "lab.pose_selection.criteria": ("Criterion", "DesignTask"),
    "lab.sensors.own_sensor": ("Sensor",),
    "lab.simulation.sampler": ("Sampler",),
}


_EXTENSIONS = {  # the lab's own extensions, with the names that each registers as ``lab.names``
    "dynamics": ("PayloadResult", "dynamics", "payload"),
    "reproduction": ("reproduce",),
    "robotics": ("convert_rotation", "solve_kinematics", "trajectory", "workspace"),
}


def __getattr__(name: str) -> object:
    for module, names in _MODULES.items():
        if name in names:
            value = globals()[name] = getattr(import_module(module), name)
            return value
    if not name.startswith("_"):
        from lab.extension_points import load, registered

        if name in registered("lab.names"):
            value = globals()[name] = load("lab.names", name)
            return value
    for extension, names in _EXTENSIONS.items():
        if name in names:
            raise AttributeError(
                f"module 'lab' has no attribute '{name}': the extension '{extension}' is not installed; install "
                "virtual-calibration-lab with its entry points"
            )
    nearest = "".join(f": is {each} meant? There" for each in get_close_matches(name, __all__, 1))
    raise AttributeError(f"module 'lab' has no attribute '{name}'{nearest or '; there'} are {', '.join(__all__)}")


def __dir__() -> list[str]:
    return __all__
