"""A public hand-eye set of a real arm through ``lab identify``: poses of the hand, and of a target in its camera.

The set is ``datasets/robot_arm_w_color_camera_real.zip`` of github.com/ethz-asl/hand_eye_calibration (BSD 3-clause,
2017; Furrer et al., "Evaluation of Combined Time-Offset Estimation and Hand-Eye Calibration on Robotic Datasets"). It
holds no pictures and no joint positions: poses over time of the hand, and of the infrared camera in the frame of a
target that it sees. So the hand is a virtual gantry of three slides and a wrist, which stands wherever it is told to,
and the target's pose is given by four of its points in the picture, with the intrinsic parameters that the set states.
The offset of the two clocks is the one with which the poses agree best.
"""

import zipfile
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import scipy
from shared import Answer, Document, Flag, Section, named_values, paragraphs, run_script

import lab
from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.sensors.cameras.closed_forms import robot_world
from lab.sensors.cameras.geometry import projected
from lab.sensors.cameras.rig import PX, read_rig

_GANTRY = """name = "gantry"
convention = "distal"
[[joint]]
name = "z"
d_mm = 0.0
a_mm = 0.0
type = "prismatic"
theta_deg = 0.0
alpha_deg = -90.0
lower_mm = -5000.0
upper_mm = 5000.0
[[joint]]
name = "y"
d_mm = 0.0
a_mm = 0.0
type = "prismatic"
theta_deg = 90.0
alpha_deg = 90.0
lower_mm = -5000.0
upper_mm = 5000.0
[[joint]]
name = "x"
d_mm = 0.0
a_mm = 0.0
theta_deg = 0.0
alpha_deg = 0.0
type = "prismatic"
lower_mm = -5000.0
upper_mm = 5000.0
[[joint]]
name = "a"
d_mm = 0.0
a_mm = 0.0
theta_deg = 0.0
alpha_deg = -90.0
lower_deg = -360.0
upper_deg = 360.0
[[joint]]
name = "b"
d_mm = 0.0
a_mm = 0.0
theta_deg = 0.0
alpha_deg = 90.0
lower_deg = -360.0
upper_deg = 360.0
[[joint]]
name = "c"
d_mm = 0.0
a_mm = 0.0
theta_deg = 0.0
alpha_deg = 0.0
lower_deg = -360.0
upper_deg = 360.0
"""
_CAMERAS = """[[camera]]
size_px = [640, 480]
focal_px = [471.8454637, 471.6859581]
centre_px = [316.8498891, 237.3886369]
distortion = [-0.150238997, -0.003258807, -0.001261507, -0.00042123, 0.0]
[[board]]
kind = "points"
points_mm = [[0.0, 0.0, 0.0], [300.0, 0.0, 0.0], [300.0, 200.0, 0.0], [0.0, 200.0, 0.0]]
"""
_LONGEST_S = 0.1  # between two poses of the hand, to be interpolated
_NEAR_S = 1.0  # offsets of the clocks that are tried


@dataclass(frozen=True)
class Options:
    """Where the set is."""

    data: Path = Path("robot_arm_w_color_camera_real.zip")
    """The set's zip file."""
    pictures: int = 250
    """Pictures to take of it, evenly."""
    json: Flag = False
    """Print one JSON object."""


def _poses(archive: zipfile.ZipFile, ending: str) -> tuple[Array, Array]:
    """Return times ``(n,)`` s and poses ``(n, 4, 4)`` m of a file: t, x, y, z, qx, qy, qz, qw."""
    name = next((each for each in archive.namelist() if each.endswith(ending)), None)
    if name is None:
        raise LabError(f"--data: has no file that ends in {ending}; take the set that the script names")
    rows = np.loadtxt(archive.open(name), delimiter=",")
    quaternions = rows[:, [7, 4, 5, 6]]
    return rows[:, 0], se3.pose(se3.rotation_from_quaternion(quaternions), rows[:, 1:4])


def _at(times: Array, hand_s: Array, hands: Array) -> tuple[Array, Array]:
    """Return the hand's poses ``(n, 4, 4)`` at some times, and which lie between near ones."""
    after = np.clip(np.searchsorted(hand_s, times), 1, len(hand_s) - 1)
    before = after - 1
    gap = hand_s[after] - hand_s[before]
    share = np.clip((times - hand_s[before]) / np.maximum(gap, 1e-9), 0.0, 1.0)[:, None]
    turn = se3.log(np.swapaxes(hands[before, :3, :3], 1, 2) @ hands[after, :3, :3])
    rotation = hands[before, :3, :3] @ se3.exp(share * turn)
    place = (1 - share) * hands[before, :3, 3] + share * hands[after, :3, 3]
    return se3.pose(rotation, place), (gap < _LONGEST_S) & (times > hand_s[0]) & (times < hand_s[-1])


def _disagreement(offset: float, seen_s: Array, boards: Array, hand_s: Array, hands: Array) -> float:
    """Return by how much (m, median) hand and target disagree where the clocks differ by so many seconds."""
    As, good = _at(seen_s + offset, hand_s, hands)
    As, Bs = As[good], se3.inverse(boards[good])
    X, Z = robot_world(As, Bs)
    return float(np.median(np.linalg.norm((As @ X - Z @ Bs)[:, :3, 3], axis=1)))


def _joints(hands: Array) -> Array:
    """Return the gantry's joint positions ``(n, 6)`` at poses of the hand: three slides, and angles about z, y, z."""
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # of the wrist, with x along its axis
    R = turn.T @ hands[:, :3, :3]
    b = np.arctan2(np.hypot(R[:, 0, 2], R[:, 1, 2]), R[:, 2, 2])
    a, c = np.arctan2(R[:, 1, 2], R[:, 0, 2]), np.arctan2(R[:, 2, 1], -R[:, 2, 0])
    return np.column_stack([hands[:, 2, 3], hands[:, 1, 3], hands[:, 0, 3], a, b, c])


def answer(options: Options) -> Answer:
    """Identify where the camera is in the hand, and where the target is, from the set.

    Raises:
        LabError: there is no such set.
    """
    if not options.data.is_file():
        raise LabError(f"--data {options.data}: there is no such file; the script names where the set is published")
    with zipfile.ZipFile(options.data) as archive:
        hand_s, hands = _poses(archive, "base_link_sr300_hinge.csv")
        seen_s, eyes = _poses(archive, "target_ir.csv")  # of the camera, in the target's frame
    boards = np.asarray(se3.inverse(eyes))
    some = np.linspace(0, len(seen_s) - 1, 2 * options.pictures).astype(np.int_)
    tried = np.linspace(-_NEAR_S, _NEAR_S, 41)
    missed = [_disagreement(float(t), seen_s[some], boards[some], hand_s, hands) for t in tried]
    start = float(tried[int(np.argmin(missed))])
    best = scipy.optimize.minimize_scalar(
        _disagreement, bounds=(start - 0.05, start + 0.05), args=(seen_s[some], boards[some], hand_s, hands),
        method="bounded",
    )  # fmt: skip
    As, good = _at(seen_s + float(best.x), hand_s, hands)
    chosen = np.flatnonzero(good)
    chosen = chosen[np.linspace(0, len(chosen) - 1, options.pictures).astype(np.int_)]
    with TemporaryDirectory() as folder:
        gantry, cameras, file = (Path(folder) / name for name in ("gantry.toml", "cameras.toml", "corners.csv"))
        gantry.write_text(_GANTRY, encoding="utf-8")
        cameras.write_text(_CAMERAS, encoding="utf-8")
        rig, joints = read_rig(cameras), _joints(As[chosen])
        points = rig.boards[0].corners @ np.swapaxes(boards[chosen, :3, :3], 1, 2) + boards[chosen, None, :3, 3]
        places = PX.of(projected(points.reshape(-1, 3), rig.cameras[0].intrinsic_values)[0]).reshape(len(chosen), -1, 2)
        lines = ["z_m,y_m,x_m,a_rad,b_rad,c_rad,corner,u_px,v_px"]
        for row, four in zip(joints, places, strict=True):
            lines += [",".join(map(repr, [*row.tolist(), k, *place])) for k, place in enumerate(four.tolist())]
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
        result = lab.identify(
            file, robot=gantry, observe="pixels", cameras=cameras, fix=("link*",), robust=True, prior="off"
        )
    found, names = result.identification, result.identification.model.names
    camera = dict(zip(names, found.values.tolist(), strict=True))
    after = result.after
    return Answer(
        values := {
            "pictures": len(chosen),
            "clock_offset_s": float(best.x),
            "closed_form_disagreement_mm": 1e3 * float(best.fun),
            "reprojection_rms_px": float(PX.of(found.residual_sigma_m)),
            "across_mm": float("nan") if after is None else after.mean,
            "outliers": len(result.fit.outliers),
            **{f"camera_{axis}_mm": 1e3 * camera[f"camera.camera.{axis}"] for axis in "xyz"},
        },
        Document("A public hand-eye set", (Section("Result", paragraphs(named_values(values))),)),
    )


if __name__ == "__main__":
    run_script("public_camera_set")
