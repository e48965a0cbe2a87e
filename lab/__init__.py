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

from importlib import import_module

from lab.core.version import __version__

__all__ = [
    "CalibrationResult",
    "CompensationResult",
    "Criterion",
    "DesignResult",
    "Effects",
    "Estimate",
    "EstimationProblem",
    "Estimator",
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
    "StudyResult",
    "Targets",
    "VerificationResult",
    "WorldFrames",
    "__version__",
    "calibrate",
    "certify",
    "compensate",
    "design",
    "dynamics",
    "example",
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
    "workspace",
    "world_frames",
    "write_measurements",
]

_MODULES = {  # where each name is, imported when it is asked for
    "lab.calibration.estimate": ("Estimate",),
    "lab.calibration.estimate_files": ("save_estimate",),
    "lab.calibration.estimator": ("EstimationProblem", "Estimator"),
    "lab.campaign.instruments": ("instrument",),
    "lab.campaign.option_groups": ("Effects",),
    "lab.campaign.robot": ("Robot", "load_robot"),
    "lab.commands.calibrate.load_run": ("load_estimate", "load_run"),
    "lab.commands.calibrate.result": ("CalibrationResult",),
    "lab.commands.calibrate.run": ("MeasurementSession", "calibrate", "identify", "simulate"),
    "lab.commands.certify.run": ("certify",),
    "lab.commands.compensate.result": ("CompensationResult",),
    "lab.commands.compensate.run": ("compensate",),
    "lab.commands.design.run": ("DesignResult", "design"),
    "lab.commands.example": ("example",),
    "lab.commands.history.run": ("history",),
    "lab.commands.import_measurements.run": ("import_measurements",),
    "lab.commands.inspect.run": ("Inspection", "inspect"),
    "lab.commands.measurements": (
        "WorldFrames",
        "measurements",
        "read_measurements",
        "robot_from_dh",
        "world_frames",
        "write_measurements",
    ),
    "lab.commands.next.planner": ("PosePlanner",),
    "lab.commands.next.run": ("next_pose",),
    "lab.commands.predict": ("PredictionResult", "predict"),
    "lab.commands.result": ("Result",),
    "lab.commands.study.run": ("StudyResult", "study"),
    "lab.commands.verify.points": ("VerificationResult",),
    "lab.commands.verify.run": ("verify",),
    "lab.core.errors": ("LabError",),
    "lab.core.measurements": ("Measurements",),
    "lab.formats.target_csv": ("Targets",),
    "lab.noise.instruments": ("Instrument",),
    "lab.pose_selection.criteria": ("Criterion",),
    "lab.simulation.sampler": ("Sampler",),
}


_EXTENSIONS = {  # the lab's own extensions, with the names that each registers as ``lab.names``
    "dynamics": ("PayloadResult", "dynamics", "payload"),
    "reproduction": ("reproduce",),
    "robotics": ("solve_kinematics", "trajectory", "workspace"),
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
    raise AttributeError(f"module 'lab' has no attribute '{name}'; there are {', '.join(__all__)}")


def __dir__() -> list[str]:
    return __all__
