"""Details of a certificate that cannot be right are named, each once; usual ones are not."""

from pathlib import Path

import pytest

from lab.certification.certificate_plausibility import CampaignFacts, implausibilities
from lab.core.checks import Check
from lab.formats.certificate_toml import read_certificate_details
from lab.phrases.phrase import phrase

GOOD = {
    "certificate": {"date": "2026-03-31", "measured_on": "2026-03-30"},
    "robot": {"maker": "ABB", "model": "IRB 120-3/0.6", "serial_number": "R1", "repeatability_mm": 0.01},
    "instrument": {
        "maker": "Leica Geosystems",
        "model": "AT960",
        "serial_number": "T1",
        "certificate_date": "2025-11-02",
        "valid_until": "2026-11-02",
    },
    "reflector": {"certificate_date": "2025-01-02"},
    "environment": {"temperature_c": 20.5, "pressure_hpa": 1013, "humidity_percent": 45, "expansion_ppm_per_k": 12},
}
FACTS = CampaignFacts("irb120", "leica-at960", "2026-03-30", 0.012)


def found(folder: Path, changes: dict[str, str | float | None], facts: CampaignFacts = FACTS) -> tuple[Check, ...]:
    """What is implausible of the good details with some changed, by ``section.name``; None takes one out."""
    sections = {section: dict(values) for section, values in GOOD.items()}
    for where, value in changes.items():
        section, name = where.split(".")
        sections[section][name] = value
    lines = []
    for section, values in sections.items():
        lines.append(f"[{section}]")
        lines += [f"{name} = {value!r}" for name, value in values.items() if value is not None]
        if section == "environment":
            lines.append("robot_temperature_k = { limit = 1 }")
    path = folder / "details.toml"
    path.write_text("\n".join(lines))
    return implausibilities(read_certificate_details(path), facts)


def test_usual_details_are_plausible(tmp_path: Path) -> None:
    assert found(tmp_path, {}) == ()
    names = ("IRB120", "irb 120", "ABB IRB 120", "IRB-120")
    assert all(found(tmp_path, {"robot.model": name}) == () for name in names)
    panda = {"robot.model": "Panda", "robot.maker": "Franka"}
    assert found(tmp_path, panda, CampaignFacts("Franka Panda", "", "2026-03-30")) == ()


IMPOSSIBLE: dict[str, tuple[dict[str, str | float | None], str, str]] = {
    "1999": (
        {"instrument.certificate_date": "1999-05-01", "instrument.valid_until": None},
        "instrument.certificate_date",
        "26.9 years older than the measurements of 2026-03-30",
    ),
    "2019": (
        {"instrument.certificate_date": "2019-05-01", "instrument.valid_until": None},
        "instrument.certificate_date",
        "6.9 years older",
    ),
    "reflector of 1999": ({"reflector.certificate_date": "1999-05-01"}, "reflector.certificate_date", "reflector of"),
    "ended": ({"instrument.valid_until": "2026-03-01"}, "instrument.valid_until", "ended on 2026-03-01, before the m"),
    "ends before it begins": ({"instrument.valid_until": "2024-03-01"}, "instrument.valid_until", "before it begins"),
    "measured after issue": ({"certificate.date": "2026-03-01"}, "certificate.date", "later than the issue of the"),
    "checked after measuring": (
        {"instrument.certificate_date": "2026-03-31"},
        "instrument.certificate_date",
        "later than the measurements of 2026-03-30",
    ),
    "another day than the run's": ({"certificate.measured_on": "2026-03-29"}, "certificate.measured_on", "2026-03-30"),
    "another robot": (
        {"robot.maker": "Universal Robots", "robot.model": "UR10"},
        "robot.model",
        "the robot Universal Robots UR10, but the run calibrates the model irb120",
    ),
    "a larger robot": ({"robot.model": "IRB 1200"}, "robot.model", "ABB IRB 1200"),
    "another maker": ({"robot.maker": "KUKA", "robot.model": None}, "robot.model", "KUKA"),
    "one serial number": ({"robot.serial_number": "T1"}, "robot.serial_number", "the same serial number, T1"),
    "heat": ({"environment.temperature_c": 68.7}, "environment.temperature_c", "68.7 °C, but the instrument works"),
}


@pytest.mark.parametrize("case", IMPOSSIBLE, ids=IMPOSSIBLE)
def test_details_that_cannot_be_right_are_named(case: str, tmp_path: Path) -> None:
    changes, where, words = IMPOSSIBLE[case]
    named = {each.data["where"]: each for each in found(tmp_path, changes)}
    assert where in named and named[where].outcome == "failed", named
    assert words in phrase(named[where])


UNUSUAL: dict[str, tuple[dict[str, str | float | None], str]] = {
    "warm": ({"environment.temperature_c": 36.0}, "robots are measured at 15 to 35"),
    "late": ({"certificate.date": "2027-06-01"}, "428 days after"),
    "another tracker": ({"instrument.model": "AT500"}, "weighted by the noise of leica-at960"),
    "micrometres": ({"robot.repeatability_mm": 10.0}, "data sheets state 0.001 to 1 mm: is the unit right?"),
    "not repeatable": ({"robot.repeatability_mm": 0.002}, "repeated poses show 0.012 mm"),
    "bar": ({"environment.pressure_hpa": 350.0}, "usual is 700 to 1080 hPa"),
    "wet": ({"environment.humidity_percent": 98.0}, "usual is 0 to 90 %"),
    "metres": ({"environment.expansion_ppm_per_k": 0.012}, "usual is 1 to 30 ppm/K"),
}


@pytest.mark.parametrize("case", UNUSUAL, ids=UNUSUAL)
def test_unusual_details_are_named_and_possible(case: str, tmp_path: Path) -> None:
    changes, words = UNUSUAL[case]
    named = found(tmp_path, changes)
    assert any(words in phrase(each) for each in named), named
    assert {each.outcome for each in named} == {"noted"}


def test_a_certificate_of_an_instrument_without_any_day_to_hold_on_cannot_be_judged(tmp_path: Path) -> None:
    without = {"certificate.date": None, "certificate.measured_on": None, "reflector.certificate_date": None}
    (named,) = found(tmp_path, without, CampaignFacts("irb120"))
    assert named.outcome == "failed" and "(2025-11-02) cannot be judged" in phrase(named)


def test_an_unknown_name_of_a_robot_is_flagged_only(tmp_path: Path) -> None:
    (named,) = found(tmp_path, {}, CampaignFacts("cell 7"))
    assert named.outcome == "noted" and "cell 7" in phrase(named)
