"""How recordings open: views of the arm and of a target from near by, and their arrangement in two columns."""

from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from lab.core import se3
from lab.core.se3 import Array
from lab.render.style import RGB_BACKDROP, RGB_FLOOR

__all__ = [
    "FAR",
    "SUMMARY",
    "backdrop",
    "bars",
    "close_view",
    "eye",
    "eye_on_arm",
    "layout",
    "magnified_view",
    "main_view",
]

SUMMARY = "summary"  # the entity of a recording's text
_POSES_PER_SECOND = 2.0  # when it is played
_CLOSE = 0.5  # of the reach: how far a close view's eye is from the target
_SHOULDER_RAD, _DOWN = 0.9, 0.35  # the main view looks past the arm: turned from the line to the instrument, and down
_SHELL = 0.12  # of the reach: how far bodies stand out from the frames, for an arm that fills the view
_FLAT, _DOWN_ON_FLAT = 0.15, 1.8  # an arm of which all is lower than this share of its width lies in a plane
FAR = 4.0  # reaches: an instrument further away does not have to be in view
_HALF_FIELD, _ASPECT = 0.5, 1.4  # what is to fit in a view: less than the viewer's field of 55 degrees


def layout(left: rrb.Container, right: rrb.Container, timeline: str) -> rrb.Blueprint:
    """Two columns and nothing else, paused at the start of a timeline."""
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[3, 2]),
        rrb.TimePanel(timeline=timeline, play_state="paused", state="collapsed", fps=_POSES_PER_SECOND),
        collapse_panels=True,
        auto_views=False,
        auto_layout=False,
    )


def main_view(name: str, controls: rrb.EyeControls3D) -> rrb.Spatial3DView:
    """The arm and what is around it; ellipsoids and what is magnified more have their own views."""
    return rrb.Spatial3DView(
        origin="world",
        name=name,
        contents=["+ /world/**", "- /world/ellipsoid/**", "- /world/magnified/**", "- /world/focus/**"],
        line_grid=_floor(),
        eye_controls=controls,
        background=backdrop(),
    )


def magnified_view(name: str, origins: Array, reach_m: float) -> rrb.Spatial3DView:
    """What is magnified, without the arm's shells, from the side; ``origins`` ``(m, f, 3)`` are the frames'."""
    middle = origins.mean(axis=(0, 1))
    controls = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=middle + reach_m * np.array([0.35, -1.1, 0.3]),
        look_target=middle,
        eye_up=(0.0, 0.0, 1.0),
    )
    return rrb.Spatial3DView(
        origin="world",
        name=name,
        contents=["+ /world/magnified/**", "+ /world/path"],
        line_grid=_floor(),
        eye_controls=controls,
        background=backdrop(),
    )


def close_view(entities: str, name: str, reach_m: float) -> rrb.Spatial3DView:
    """The target with one ellipsoid or what is magnified (below ``world``); ``world/focus`` is where it looks."""
    return rrb.Spatial3DView(
        origin="world/focus",
        name=name,
        contents=["+ /world/arm/**", "+ /world/targets/measured", f"+ /world/{entities}/**"],
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=_CLOSE * reach_m * np.array([0.45, -0.8, 0.4]),
            look_target=(0.0, 0.0, 0.0),
            eye_up=(0.0, 0.0, 1.0),
        ),
        background=backdrop(),
    )


def bars(origin: str, name: str) -> rrb.BarChartView:
    """A bar chart without a legend."""
    return rrb.BarChartView(origin=origin, name=name, plot_legend=rrb.PlotLegend(visible=False))


def eye(origins: Array, points: Array, reach_m: float, head: Array) -> rrb.EyeControls3D:
    """Over the arm's shoulder towards the instrument: the arm near and large, the instrument behind it.

    One that lies in a plane is looked down upon, without the instrument.

    Args:
        origins: ``(m, f, 3)`` of the frames, base outward.
        points: ``(k, 3)`` further ones to show.
        head: ``(3,)`` the instrument's.
    """
    foot = origins[0, 0] + 0.25 * reach_m * np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
    arm = np.concatenate([foot, origins.reshape(-1, 3), points])
    middle = (arm.min(axis=0) + arm.max(axis=0)) / 2
    towards = (head - middle) * np.array([1.0, 1.0, 0.0])
    distance = float(np.linalg.norm(towards))
    towards = towards / distance if distance > 1e-6 else np.array([1.0, 0.0, 0.0])
    extent = np.ptp(arm, axis=0)
    flat = bool(extent[2] < _FLAT * extent.max())
    down = _DOWN_ON_FLAT if flat else _DOWN
    forward = se3.exp(np.array([0.0, 0.0, _SHOULDER_RAD])) @ towards + np.array([0.0, 0.0, -down])
    forward /= np.linalg.norm(forward)
    near = distance < FAR * reach_m and not flat
    more = head + np.array([[0.0, 0.0, 0.3], [0.0, 0.0, -head[2]]]) if near else arm[:0]
    if flat:  # room for what is drawn above and below its plane
        more = np.concatenate([arm + np.array([0.0, 0.0, sign * 0.25 * reach_m]) for sign in (1, -1)])
    span = np.concatenate([arm, more])
    target, back = _framed(span, forward)
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital, position=target - back * forward, look_target=target, eye_up=(0.0, 0.0, 1.0)
    )


def eye_on_arm(origins: Array, points: Array, reach_m: float) -> rrb.EyeControls3D:
    """From in front and from the side, of an arm that nothing measures; arguments as those of ``eye``."""
    shells = origins.reshape(-1, 3)[:, None] + _SHELL * reach_m * np.array([[0, 0, 1], [0, 0, -1], [1, -1, 0]])
    behind = origins[0, 0] + FAR * reach_m * np.array([0.2, 1.0, 0.0])  # no instrument: a direction alone
    return eye(origins, np.concatenate([points, shells.reshape(-1, 3)]), reach_m, behind)


def _framed(points: Array, forward: Array) -> tuple[Array, float]:
    """Where to look, and from how far back along ``forward``, so that all ``points`` ``(n, 3)`` are in view."""
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    target, back = points.mean(axis=0), 0.0
    for _ in range(5):  # centre the picture, which moves as the eye does
        local = points - target
        depth, across, above = local @ forward, local @ right, local @ up
        needed = np.maximum(np.abs(across) / (_ASPECT * _HALF_FIELD), np.abs(above) / _HALF_FIELD)
        back = float((needed - depth).max())
        u, v = across / (depth + back), above / (depth + back)
        target = target + 0.5 * back * ((u.min() + u.max()) * right + (v.min() + v.max()) * up)
    return target, back


def _floor() -> rrb.archetypes.LineGrid3D:
    """A grid of 100 mm."""
    return rrb.LineGrid3D(visible=True, spacing=0.1, plane=rr.components.Plane3D.XY, stroke_width=0.5, color=RGB_FLOOR)


def backdrop() -> Any:
    """What every 3D view stands before."""
    return rrb.Background(kind=rrb.BackgroundKind.SolidColor, color=RGB_BACKDROP)
