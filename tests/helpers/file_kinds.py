"""A valid file of every kind that the lab reads, and what reads it."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial.transform import Rotation

from helpers.bad_input import ARM_TOML, ARM_URDF, ARM_XML, csv
from helpers.controller_programs import END, LANGUAGES, PULSES, Written, posed, program
from helpers.daily_checks import daily
from helpers.robots import IRB120, ROOT
from helpers.tracker_files import spatial_analyzer
from helpers.writing_commands import weighted
from lab.extensions.cameras.rig import read_rig
from lab.extensions.dynamics.load_files import read_load, read_loads, read_motion, read_mounting
from lab.extensions.robotics.trajectory.motion import read_path
from lab.formats.cell_toml import read_cell
from lab.formats.certificate_toml import read_certificate_details
from lab.formats.corner_export import read_corners
from lab.formats.drives_toml import read_drives
from lab.formats.instrument_toml import read_instrument
from lab.formats.joint_log import read_joint_log
from lab.formats.loose_table import JointColumns, PointColumns, read_column_map, read_loose
from lab.formats.measurement_csv import read_measurements, write_measurements
from lab.formats.mechanism_toml import read_mechanism
from lab.formats.programs.languages import read_program
from lab.formats.programs.program_text import Outside
from lab.formats.robot_toml import read_table
from lab.formats.target_csv import read_joints, read_targets
from lab.formats.tracker_export import read_tracker_points
from lab.formats.ur_calibration import read_corrections
from lab.library.hand_load import read_hand_load
from lab.library.load_run import load_run
from lab.options.virtual_campaign import VirtualCampaign
from lab.robots.config_file import read_options
from lab.robots.load_robot import load_robot
from lab.simulation.load_model import load_model
from lab.studies.grid import read_study

__all__ = ["KINDS", "LONG_RUNS", "RUNS", "STUDY", "FileKind", "calibration", "weighing"]

JOINTS, SLIDES = ("q1", "q2", "rail"), (False, False, True)
RUNS = "time_s,q1_rad,q2_rad,rail_m,tau1_nm,tau2_nm,f3_n,run\n" + "".join(
    f"{0.01 * i:.2f},{0.1 * i:.3f},0.2,0.1,{i}.5,1.25,-3,{'loaded' if i < 12 else 'unloaded'}\n" for i in range(24)
)
PHASES = 2 * np.pi * np.arange(320) / 160  # two swings of 1.6 s
LONG_RUNS = "time_s,q1_rad,q2_rad,rail_m,tau1_nm,tau2_nm,f3_n,run\n" + "".join(
    f"{0.01 * i:.2f},{np.sin(p):.6f},{0.5 * np.cos(2 * p):.6f},{0.15 + 0.1 * np.sin(3 * p):.6f},"
    f"{10 * np.sin(p):.6f},{20 * np.cos(2 * p):.6f},{5 + np.sin(3 * p):.6f},{'loaded' if i < 160 else 'unloaded'}\n"
    for i, p in enumerate(PHASES)
)
CAMERAS = """\
[[camera]]
name = "wrist"
focal_px = [1200.0, 1200.0]
distortion = [-0.2, 0.05, 0.001, -0.001, 0.0]
intrinsics = "prior"
prior_px = 5.0
[[board]]
kind = "apriltag"
columns = 4
rows = 3
tag_mm = 30.0
gap_mm = 10.0
[simulated]
noise_px = 0.1
"""
STUDY = """\
name = "s"
robots = 2
draws = 2
[factors]
criterion = ["O1", "random"]
poses = [12, 20]
effects = ["none", "soft"]
[effects.soft]
stiffness_nm_per_rad = 1e5
[parameters.few]
fix = ["link1.*"]
"""
SENSOR = "[base]\ntilt_x_deg = 1.5\n[sensor]\nsign = -1\nrotation_vector_deg = [0, 0, 30]\n"
LOAD = json.dumps({"mass_kg": 1.5, "com_m": [0, 0, 0.1], "covariance_of_mass_and_moment": np.eye(4).tolist()})
CONFIG = json.dumps({"schema": 1, "command": "calibrate", "options": {"poses": 5, "effects": {"gear_ppm": 3.0}}})
MECHANISM = (ROOT / "models" / "rpr3" / "mechanism.toml").read_text()
CELL = """\
clearance_mm = 5
[robot]
position_mm = [0, 0, 100]
rotation_deg = [0, 0, 30]
[[obstacle]]
name = "table"
shape = "box"
size_mm = [100, 200, 300]
position_mm = [900, 0, 0]
[[tool]]
name = "p1"
position_mm = [1, 2, 3]
axis = [0, 0, 1]
[reflector]
kind = "other"
acceptance_deg = 20
[joints.q1]
lower_deg = -40
upper_deg = 20
[home]
q1_deg = 0
q2_deg = 10
rail_mm = 50
"""
CERTIFICATE = """\
[certificate]
number = "42"
date = 2026-03-31
issued_by = "Us"
[robot]
serial_number = "R1"
repeatability_mm = 0.01
[instrument]
certificate_date = "2025-11-02"
[environment]
temperature_c = 20.5
robot_temperature_k = { limit = 1.5 }
expansion_ppm_per_k = 12
"""
DRIVES = """\
[[drive]]
gear_ratio = -48
torque_nm_per_a = 0.2
[[drive]]
gear_ratio = 32
torque_nm_per_a = 0.1
[[coupling]]
drive = 2
joint = 1
ratio = 16
"""
THIRD_DRIVE = "[[drive]]\ngear_ratio = 2\ntorque_nm_per_a = 0.3\n"
TRACKER = """\
name = 'Tracker 7'
[noise]
radial_um = 2
radial_um_per_m = 0.5
transverse_um = 7.5
transverse_um_per_m = 3
[field_of_view]
lowest_deg = -45
[systematic]
two_face = true
transit_tilt_urad = { standard = 5, freedom = 20 }
azimuth_eccentricity_urad = { limit = 6, distribution = "arcsine" }
"""
RIGID_LOAD = "[load]\nmass_kg = 1.5\ncom_mm = [10, -5, 60]\ninertia_kgcm2 = [22.5, 26, 12.5, 0, 0, 0]\n"
MOTION = (
    "id,move,q1_deg,q2_deg,rail_mm,speed_q1_deg_per_s\na,,90,10,100,\nb,joint,0,20,50,-20\nc,joint,-20,25,60,\n"
    "d,line,-10,25,65,\ne,via,-5,20,60,\nf,circle,0,25,55,\n"
)
POSITIONS = "id,use,q1_deg,q2_rad,rail_mm\na,test,90,1.5,100\nb,skip,0,0,0\nc,test,-90,0,7\n"
CORNERS = "time,camera,board,corner,u_px,v_px\n12.5,wrist,table,0,100.25,200.5\n12.5,wrist,table,1,150.0,201.0\n"
LOG = "date,timestamp,q1 [deg],q2 [deg],rail_mm\n" + "".join(
    f"2026-03-31,10:00:{i:02d}.5,{10 * i},{-i},{5 * i}\n" for i in range(3)
)
COLUMNS = """\
[points]
name = "Target"
x = "X"
y = "Y"
z = "Z"
sigma = ["Ux", "Uy", "Uz"]
dates = "dmy"
[joints]
joints = ["q1 [deg]", "q2 [deg]", "rail_mm"]
unit = "deg"
"""
LINKS = """\
[[link]]
number = 1
material = "steel"
tube_mm = [80, 4]
[[link]]
number = 2
ei_nm2 = 2e4
gj_nm2 = 1e4
ea_n = 1e8
"""
CORRECTIONS = "[mounting]\ncalibration_status = 2 # 2: linearised\n" + "".join(
    f"delta_{name} = [1e-5, 0.25, -0.25, 1e-4, -3e-05, 0]\n" for name in ("theta", "a", "d", "alpha")
)
DATE = "2026-03-01"
SIX = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
_FRAMES = {"fanuc": ("UTOOL[2]", "UFRAME[3]"), "jbi": ("TOOL[2]", "USER[3]")}  # which a text only numbers

Reader = Callable[[Path], object]


@dataclass(frozen=True)
class FileKind:
    """What such a file is called, the text of a valid one, and what reads it."""

    name: str
    text: Callable[[], str]
    read: Reader


def _of_a_run(path: Path) -> object:
    """The load of a run of ``lab payload`` whose other files are as they should be."""
    beside = path.with_name("config.json")
    beside.write_text('{"options": {}}')
    try:
        return read_hand_load(path.parent, accept_edited=True)
    finally:
        beside.unlink()


def _kind(name: str, text: str, read: Reader) -> FileKind:
    return FileKind(name, lambda: text, read)


@cache
def calibration() -> dict[str, bytes]:
    """The files of a small calibration of an IRB 120, nothing of it drawn."""
    import lab
    from helpers.drawing import nothing_drawn

    with TemporaryDirectory() as folder, nothing_drawn():
        lab.calibrate("irb120", poses=20, seed=1, date=DATE).save(Path(folder) / "run")
        return {path.name: path.read_bytes() for path in (Path(folder) / "run").iterdir()}


def _text_of(name: str) -> Callable[[], str]:
    return lambda: calibration()[name].decode()


def _calibrated(path: Path) -> object:
    """The run one file of which is given, and the others are as they were."""
    others = {name: content for name, content in calibration().items() if name != path.name}
    for name, content in others.items():
        path.with_name(name).write_bytes(content)
    try:
        return load_run(path.parent, accept_edited=True)
    finally:
        for name in others:
            path.with_name(name).unlink()


@cache
def _program(language: str) -> Written:
    """A program through two poses and one position of the joints."""
    rng = np.random.default_rng(3)
    poses = np.array([posed(Rotation.random(random_state=rng), rng.uniform(-0.9, 0.9, 3)) for _ in range(2)])
    base = np.eye(4) if language == "urscript" else posed(Rotation.random(random_state=rng), rng.uniform(-1, 1, 3))
    return program(language, poses, rng.uniform(-2, 2, (1, 6)), posed(Rotation.identity(), np.ones(3)), base, rng)


def _read_program(language: str, path: Path) -> object:
    frames: dict[str, tuple[float, ...] | str] = dict.fromkeys(
        _FRAMES.get(language, ()), (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    )
    outside = Outside(frames, tuple(PULSES) if language == "jbi" else ())
    return read_program(path, path.read_bytes().decode("latin-1"), IRB120.chain, language, outside)


@cache
def weighing() -> dict[str, str]:
    """The files of a payload that a wrist sensor of a TX 40 feels at rest."""
    with TemporaryDirectory() as folder:
        weighted(Path(folder))
        return {path.name: path.read_text() for path in Path(folder).iterdir()}


def _daily() -> str:
    with TemporaryDirectory() as folder:
        write_measurements(Path(folder) / "daily.csv", daily(12), (False,) * 6)
        return (Path(folder) / "daily.csv").read_text()


def _export() -> str:
    rng = np.random.default_rng(5)
    with TemporaryDirectory() as folder:
        points, sigma = 0.1 * rng.normal(size=(3, 3)), np.full((3, 3), 1e-5)
        file = spatial_analyzer(Path(folder) / "sa.txt", ("A1", "A2", "A3"), points, sigma)
        return file.read_text()


KINDS: dict[str, FileKind] = {
    "measurements": _kind("m.csv", csv(), lambda path: read_measurements(path, JOINTS, SLIDES)),
    "day": FileKind(
        "d.csv",
        _text_of("measurements.csv"),
        lambda path: read_measurements(path, IRB120.chain.joint_names, IRB120.chain.prismatic),
    ),
    "daily": FileKind(
        "daily.csv",
        _daily,
        lambda path: read_measurements(path, IRB120.chain.joint_names, IRB120.chain.prismatic, points=False),
    ),
    "targets": _kind("t.csv", csv(), lambda path: read_targets(path, JOINTS, SLIDES)),
    "runs": _kind("r.csv", RUNS, lambda path: read_loads(path, JOINTS, SLIDES)),
    "payload": FileKind(
        "w.csv",
        lambda: weighing()["runs.csv"],
        lambda path: read_loads(path, load_robot("tx40").chain.joint_names, (False,) * 6),
    ),
    "motion": _kind("r.csv", LONG_RUNS, lambda path: read_motion(path, JOINTS, SLIDES)),
    "table": _kind("a.toml", ARM_TOML, read_table),
    "table with drives": _kind("a.toml", ARM_TOML + DRIVES + THIRD_DRIVE, read_table),
    "mechanism": _kind("k.toml", MECHANISM, read_mechanism),
    "study": _kind("s.toml", STUDY, read_study),
    "mounting": _kind("b.toml", SENSOR, read_mounting),
    "MJCF": _kind("a.xml", ARM_XML, load_model),
    "URDF": _kind("a.urdf", ARM_URDF, load_model),
    "config": _kind("config.json", CONFIG, lambda path: read_options(path, "calibrate", VirtualCampaign)),
    "load": _kind("load.json", LOAD, _of_a_run),
    "cell": _kind("cell.toml", CELL, read_cell),
    "certificate": _kind("details.toml", CERTIFICATE, read_certificate_details),
    "drives": _kind("drives.toml", DRIVES + THIRD_DRIVE, lambda path: read_drives(path, 3)),
    "tracker": _kind("tracker.toml", TRACKER, read_instrument),
    "cameras": _kind("cameras.toml", CAMERAS, read_rig),
    "rigid load": _kind("load.toml", RIGID_LOAD, read_load),
    "path": _kind("p.csv", MOTION, lambda path: read_path(path, JOINTS, SLIDES)),
    "joints": _kind("j.csv", POSITIONS, lambda path: read_joints(path, JOINTS, SLIDES)),
    "log": _kind("l.csv", LOG, lambda path: read_joint_log(path, JOINTS, SLIDES, JointColumns(), None)),
    "export": FileKind(
        "e.txt", _export, lambda path: read_tracker_points(read_loose(path, 3), PointColumns(), None, 1.0)
    ),
    "corners": _kind("v.csv", CORNERS, lambda path: read_corners(read_loose(path, 3), PointColumns())),
    "columns": _kind("c.toml", COLUMNS, read_column_map),
    "elastic links": _kind("a.toml", ARM_TOML + LINKS, read_table),
    "corrections": _kind("calibration.conf", CORRECTIONS, read_corrections),
    **{
        f"run's {name}": FileKind(name, _text_of(name), _calibrated)
        for name in ("config.json", "result.json", "parameters.json", "covariance.csv", "SHA256SUMS")
    },
    **{
        f"{language} program": FileKind(
            "p" + END[language],
            partial(lambda language: _program(language).content.decode("latin-1"), language),
            partial(_read_program, language),
        )
        for language in LANGUAGES
    },
}
