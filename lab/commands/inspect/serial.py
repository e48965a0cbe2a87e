"""The drawing and the shape of a serial arm: as plain values, and in words."""

from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from lab.commands.inspect.format import joint_kind, joint_limits, limits_and_speed, printed, tidy, with_reading
from lab.commands.inspect.serial_shape import LEAST, shape_of
from lab.kinematics.serial.chain import COLUMNS, Chain


def drawn_serial(chain: Chain) -> dict[str, Any]:
    """The table, its convention, and limits."""
    return {"convention": chain.convention, "joints": [_joint(chain, i) for i in range(chain.size)]}


def shape_serial(chain: Chain) -> dict[str, Any]:
    """Reach, ways to a pose, the Jacobian's determinant, and an example of each singularity."""
    shape, names = shape_of(chain), chain.joint_names
    scale = np.where(chain.prismatic, 1e3, 180 / np.pi)
    return {
        "reach_mm": tidy(1e3 * shape.reach_m),
        "ways": shape.ways,
        "determinant": shape.determinant or None,
        "singularities": [
            {
                "name": each.factor.name,
                "where": each.factor.text,
                "example": None if each.joints is None else [tidy(value) for value in each.joints * scale],
                "free": [
                    {name: tidy(part) for name, part in zip(names, parts, strict=True) if abs(part) > LEAST}
                    for parts in each.free
                ],
            }
            for each in shape.singularities
        ],
    }


def _joint(chain: Chain, i: int) -> dict[str, Any]:
    """A joint's row of the table, with its limits."""
    cells = {
        f"{c}_{'mm' if c in 'da' else 'deg'}": tidy(chain.table[i, j] * (1e3 if c in "da" else 180 / np.pi))
        for j, c in enumerate(COLUMNS)
    }
    return {**joint_kind(chain, i), **cells, **joint_limits(chain, i)}


def print_serial(console: Console, seen: dict[str, Any]) -> None:
    """The table, how far the arm reaches, and where it is singular."""
    order = "Rz(θ) Tz(d) Tx(a) Rx(α)" if seen["convention"] == "distal" else "Rx(α) Tx(a) Rz(θ) Tz(d)"
    console.print(f"{seen['robot']}: Denavit-Hartenberg, {seen['convention']}, {order}; mm and °")
    console.print(_drawn_table(seen["joints"]))
    ways = "" if seen["ways"] is None else f"; {seen['ways']} ways to a pose"
    console.print(f"reach {printed(seen['reach_mm'])} mm from axis 1 to the last frame{ways}")
    if seen["determinant"] is None:
        return
    text = seen["determinant"].replace("-", "−").replace("*", "·")
    console.print(f"det J = {text} (m), singular where a factor is zero:", soft_wrap=True)
    for each in seen["singularities"]:
        where = f"  {each['name']}, {each['where']} = 0".replace("-", "−")
        if each["example"] is None:
            console.print(f"{where}: not within the limits")
            continue
        parts = " or ".join(" ".join(f"{part:+.3g} {name}" for name, part in one.items()) for one in each["free"])
        at = ", ".join(f"{value:.1f}" for value in np.round(each["example"], 1) + 0.0)
        console.print(f"{where}: e.g. at ({at}), {parts} moves nothing".replace("-", "−"), soft_wrap=True)


def _drawn_table(joints: list[dict[str, Any]]) -> Table:
    """The Denavit-Hartenberg table with limits, as the literature prints it."""
    table = Table()
    for heading in ("i", "θ", "d", "a", "α", "limits", "speed per s"):
        table.add_column(heading, justify="right", no_wrap=True)
    for i, joint in enumerate(joints):
        slides = joint["type"] == "prismatic"
        theta, d = printed(joint["theta_deg"]), printed(joint["d_mm"])
        moved = with_reading(joint["name"], joint["sign"], joint["d_mm" if slides else "theta_deg"])
        theta, d = (theta, moved) if slides else (moved, d)
        table.add_row(
            str(i + 1), theta, d, printed(joint["a_mm"]), printed(joint["alpha_deg"]), *limits_and_speed(joint)
        )
    return table
