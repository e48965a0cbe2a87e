"""Section 6.1: the volumes that the five carriers reach, hinges turning by 360° and slides moving by L."""

from functools import cache

import numpy as np

from lab.campaign.robot import load_robot
from lab.extensions.reproduction.answer import Answer, holds, number
from lab.extensions.reproduction.item import Item
from lab.extensions.robotics.workspace.sections import carrier_volume
from lab.kinematics.serial.chain import Chain
from lab.render.charts.axes import Axes
from lab.render.document import Picture
from lab.render.style import AFTER
from lab.render.svg import axes_picture

__all__ = ["VOLUME_ITEMS"]

_CLOSED = {  # L = 1 m: closed formulas
    "RPP, cylindrical (6.1.1)": np.pi,
    "RRR, anthropomorphic (6.1.2)": 32 * np.pi / 3,
    "PPP, Cartesian (6.1.3)": 1.0,
    "RRP, spherical (6.1.4)": 4 * np.pi / 3,
    "RRP, toric (6.1.5)": 4 * np.pi,
}


@cache
def _volumes() -> dict[str, float]:
    names = ("cylindrical", "anthropomorphic", "cartesian", "spherical", "scara")
    found = {}
    for title, name in zip(_CLOSED, names, strict=True):
        chain = load_robot(f"carrier/{name}").chain
        assert isinstance(chain, Chain)
        found[title] = carrier_volume(chain, np.zeros(3), 3.5)
    return found


def _answers() -> tuple[Answer, ...]:
    found = _volumes()
    apart = max(abs(found[name] / closed - 1) for name, closed in _CLOSED.items())
    return (
        *(number(f"volume / L³, {name}", "", value, digits=2) for name, value in found.items()),
        holds("π, 32 π/3, 1, 4 π/3 and 4 π, relative", apart, within=1e-3),
    )


def _picture() -> tuple[Picture, ...]:
    found = _volumes()

    def draw(axes: Axes) -> None:
        at = np.arange(len(found))[::-1]
        axes.barh(at, list(found.values()), color=AFTER, height=0.6)
        for place, value in zip(at, found.values(), strict=True):
            axes.annotate(f"{value:.2f}", (value + 0.4, place), va="center", fontsize=8)
        axes.set_yticks(at, list(found))
        axes.set(xlabel="volume / L³", xlim=(0, 40))

    return (axes_picture("carriers", "Volumes of the five carriers", (5.6, 2.6), draw, (2.2, 0.5, 0.15, 0.15)),)


VOLUME_ITEMS = (
    Item("Section 6.1", "Volumes of the five carriers", _answers, "lab workspace carriers",
         "Hinges turn by 360°, slides move from 0 to L, and "
         "a link is as long as L if it bears a hinge, else nothing. By exact sections of what the closed-form inverse "
         "reaches within the limits; L = 1 m.", _picture),
)  # fmt: skip
