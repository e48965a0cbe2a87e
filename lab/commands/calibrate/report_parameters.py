"""The parameters of a run's report in what a person reads, and the table of them."""

from typing import Any

from lab.commands.calibrate.result import human_unit
from lab.render.html import Html, element, fixed, short, table

MOST_ALIASES = 4
_PLACED = ("base", "tool", "anchor", "socket", "plane", "cable")  # groups without a drawing


def changes_of(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Each parameter in what a person reads: ``change`` and ``half`` (of its interval), None where there is none.

    Base, tool and other places have no drawing, so nothing that they differ from.
    """
    found = []
    for row in rows:
        scale, unit, digits = human_unit(row["name"], row["unit"])
        identified = row["status"] == "identified"
        drawn = identified and not row["name"].startswith(tuple(f"{group}." for group in _PLACED))
        interval = row["interval_95"]
        found.append(
            {
                "name": row["name"],
                "unit": unit,
                "digits": digits,
                "before": scale * row["nominal"],
                "estimate": scale * row["estimate"] if identified else None,
                "change": scale * (row["estimate"] - row["nominal"]) if drawn else None,
                "half": None if interval is None else scale * (interval[1] - interval[0]) / 2,
                "status": _held(row),
            }
        )
    return found


def _held(row: dict[str, Any]) -> str:
    """The status; of one that is fixed, into what its error goes."""
    into = sorted(row["aliases"], key=lambda name: -abs(row["aliases"][name]))
    more = f" and {len(into) - MOST_ALIASES} more" if len(into) > MOST_ALIASES else ""
    return f"{row['status']}; acts as {', '.join(into[:MOST_ALIASES])}{more}" if into else str(row["status"])


def parameters_table(rows: list[dict[str, Any]]) -> Html:
    """Every parameter with its 95 % interval, or why it has none."""
    lines = []
    for row in rows:
        digits, half, estimate, change = row["digits"], row["half"], row["estimate"], row["change"]
        lines.append(
            [
                element("code", row["name"]),
                row["unit"],
                fixed(row["before"], digits),
                "" if estimate is None else fixed(estimate, digits),
                "" if change is None else fixed(change, digits, signed=True),
                "" if half is None else f"± {short(half)}",
                row["status"],
            ]
        )
    header = ["parameter", "unit", "before", "identified", "change", "95 % interval", "status"]
    kinds = ["" if row["estimate"] is not None else "quiet" for row in rows]
    return table(header, lines, kinds=kinds)
