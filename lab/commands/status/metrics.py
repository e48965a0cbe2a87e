"""The state of arms as metrics: Prometheus's text exposition, version 0.0.4, for the textfile collector."""

from collections.abc import Iterator, Sequence
from datetime import UTC, date, datetime

from lab.commands.status.arm import STATES, ArmStatus

__all__ = ["exposition"]

_STATES = ", ".join(f"{i} {word}" for i, word in enumerate(STATES))
_ESCAPES = str.maketrans({"\\": r"\\", '"': r"\"", "\n": r"\n"})


def exposition(arms: Sequence[ArmStatus], left_out: int) -> str:
    """Return the text that a scraper reads: a family for each quantity, a line for each arm that has it.

    Days are the seconds of their first moment, UTC.

    Args:
        left_out: how many runs could not be used.
    """
    families = (
        ("lab_arm_state", f"State of the arm: {_STATES}.", [_state(each) for each in arms]),
        ("lab_arm_error_mm", "Mean position error at the last check, mm.", [_error(each) for each in arms]),
        (
            "lab_arm_last_calibration_timestamp_seconds",
            "Day of the last calibration.",
            [None if each.calibration is None else _seconds(each.calibration.on) for each in arms],
        ),
        ("lab_arm_due_timestamp_seconds", "Last day for the next check.", [_seconds(each.due) for each in arms]),
    )
    lines = list[str]()
    for name, text, values in families:
        lines += _head(name, text)
        lines += [
            f"{name}{_labels(arm)} {value!r}" for arm, value in zip(arms, values, strict=True) if value is not None
        ]
    name = "lab_status_left_out_runs"
    lines += [*_head(name, "Runs of the folder that could not be used."), f"{name} {left_out}"]
    return "\n".join(lines) + "\n"


def _head(name: str, text: str) -> Iterator[str]:
    yield f"# HELP {name} {text}"
    yield f"# TYPE {name} gauge"


def _labels(arm: ArmStatus) -> str:
    serial, robot = ((each or "").translate(_ESCAPES) for each in (arm.serial, arm.robot))
    return f'{{serial="{serial}",robot="{robot}"}}'


def _state(arm: ArmStatus) -> int:
    return STATES.index(arm.state)


def _error(arm: ArmStatus) -> float | None:
    return arm.error_now_mm if arm.error_now_mm is not None else arm.error_then_mm


def _seconds(on: date | None) -> int | None:
    return None if on is None else int(datetime(on.year, on.month, on.day, tzinfo=UTC).timestamp())
