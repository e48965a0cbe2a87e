"""Check what a certificate states beside its numbers: dates, names, surroundings.

Some details cannot be true together: a measurement after the certificate's issue, an instrument whose certificate had
ended, another robot's name. Such a certificate is not issued. Others can be true and are unusual: they are named.
Nothing depends on the day on which the certificate is made.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from typing import Any

from lab.core.checks import Check
from lab.formats.certificate_toml import CertificateDetails
from lab.formats.programs.languages import language_of_maker

__all__ = ["CampaignFacts", "implausibilities"]

_USUAL_C = (15.0, 35.0)  # of a hall in which robots are measured
_LONGEST_YEARS = 2.0  # between two calibrations of an instrument, where its certificate states no end
_LONGEST_DAYS_TO_ISSUE = 365  # from the measurements to the certificate
_USUAL_PRESSURE_HPA = (700.0, 1080.0)  # from 3,000 m up to the highest at sea level
_MOST_HUMID_PERCENT = 90.0  # above, water condenses on cooler glass
_USUAL_EXPANSION_PPM = (1.0, 30.0)  # from carbon fibre to aluminium alloys
_MOST_ROBOT_KELVIN = 30.0  # by which a working robot is warmer than its surroundings
_USUAL_REPEATABILITY_MM = (1e-3, 1.0)  # RP that data sheets of robots state
_REPEATABILITY_RATIO = 3.0  # of the measured to the stated one, either way
_YEAR = 365.25  # days


@dataclass(frozen=True)
class CampaignFacts:
    """Facts of a run that a certificate's details are checked against.

    Attributes:
        robot: the name of the robot's model.
        instrument: the preset by whose noise the run was weighted; "" where it is none.
        measured_on: the date of the measurements by the run's option, "" where it has none.
        repeatability_mm: RP as measured; None where no pose was repeated.
    """

    robot: str
    instrument: str = ""
    measured_on: str = ""
    repeatability_mm: float | None = None


def implausibilities(details: CertificateDetails, facts: CampaignFacts) -> tuple[Check, ...]:
    """Check all details of a certificate against each other and against the run.

    Returns:
        The checks that found something: failed where no certificate can be issued with it, noted where it is unusual.
        Their data has ``where``, the details' section and name.
    """
    return (
        *_of_dates(details, facts),
        *_of_robot(details, facts),
        *_of_instrument(details, facts),
        *_of_surroundings(details),
        *_of_repeatability(details, facts),
    )


def _of_dates(details: CertificateDetails, facts: CampaignFacts) -> Iterator[Check]:
    measured_on = details.certificate.measured_on
    stated, issued = _day(measured_on or facts.measured_on), _day(details.certificate.date)
    if measured_on and facts.measured_on not in ("", measured_on):
        days = {"stated": measured_on, "of_run": facts.measured_on}
        yield _found("other_day", "certificate.measured_on", impossible=True, **days)
    days_to_issue = (issued - stated).days if stated and issued else 0
    if days_to_issue < 0:
        yield _found("issued_before", "certificate.date", impossible=True, measured_on=stated, issued=issued)
    if days_to_issue > _LONGEST_DAYS_TO_ISSUE:
        late = {"measured_on": stated, "issued": issued, "days": days_to_issue}
        yield _found("issued_late", "certificate.date", impossible=False, **late)
    for name, gauge in (("instrument", details.instrument), ("reflector", details.reflector)):
        yield from _of_certificate(name, _day(gauge.certificate_date), _day(gauge.valid_until), stated, issued)


def _of_certificate(
    name: str, checked: date | None, until: date | None, measured: date | None, issued: date | None
) -> Iterator[Check]:
    """Check the certificate of an instrument or a reflector: it has to hold on the date of the measurements."""
    where, end = f"{name}.certificate_date", f"{name}.valid_until"
    dates: dict[str, Any] = {"gauge": name, "checked": checked, "until": until, "issued": issued}
    if _later(checked, until):
        yield _found("ends_before_begin", end, impossible=True, **dates)
        return
    if _later(checked, issued):
        yield _found("later_than_issue", where, impossible=True, **dates)
    on = measured or issued
    if on is None:
        if checked or until:
            yield _found("no_day", where, impossible=True, **dates)
        return
    dates |= {"on": on, "measured": measured is not None}
    if _later(checked, measured):
        yield _found("later_than_measured", where, impossible=True, **dates)
    if _later(on, until):
        yield _found("ended", end, impossible=True, **dates)
    years = (on - checked).days / _YEAR if checked and not until else 0.0
    if years > _LONGEST_YEARS:
        yield _found("old", where, impossible=True, years=years, **dates)


def _later(day: date | None, other: date | None) -> bool:
    """Decide whether a date is after another one; not, where one is not known."""
    return day is not None and other is not None and day > other


def _of_robot(details: CertificateDetails, facts: CampaignFacts) -> Iterator[Check]:
    robot = details.robot
    stated = f"{robot.maker} {robot.model}".strip()
    makers = language_of_maker(stated), language_of_maker(facts.robot)
    other = robot.model and not (_names(robot.model, facts.robot) or _names(facts.robot, stated))
    if other or (None not in makers and makers[0] is not makers[1]):
        impossible = makers[1] is not None
        yield _found("other_robot", "robot.model", impossible=impossible, stated=stated, of_run=facts.robot)
    if robot.serial_number and robot.serial_number == details.instrument.serial_number:
        yield _found("same_serial", "robot.serial_number", impossible=True, serial=robot.serial_number)


def _of_instrument(details: CertificateDetails, facts: CampaignFacts) -> Iterator[Check]:
    stated = f"{details.instrument.maker} {details.instrument.model}".strip()
    known = facts.instrument
    if details.instrument.model and known and not _shares_a_word(stated, known):
        yield _found("other_instrument", "instrument.model", impossible=False, stated=stated, of_run=known)


def _of_surroundings(details: CertificateDetails) -> Iterator[Check]:
    room = details.environment
    yield from _of_temperature(details)
    if (known := details.robot_temperature) is not None:
        spread = min(known[0].limit, 2 * known[0].standard)
        if spread > _MOST_ROBOT_KELVIN:
            sizes = {"spread_k": spread, "most_k": _MOST_ROBOT_KELVIN}
            yield _found("robot_temperature", "environment.robot_temperature_k", impossible=False, **sizes)
    numbers: dict[str, tuple[float | None, tuple[float, float], str]] = {
        "expansion_ppm_per_k": (room.expansion_ppm_per_k, _USUAL_EXPANSION_PPM, "ppm/K"),
        "pressure_hpa": (room.pressure_hpa, _USUAL_PRESSURE_HPA, "hPa"),
        "humidity_percent": (room.humidity_percent, (0.0, _MOST_HUMID_PERCENT), "%"),
    }
    for name, (value, (least, most), unit) in numbers.items():
        if value is not None and not least <= value <= most:
            sizes = {"value": value, "least": least, "most": most}
            yield _found("unusual_number", f"environment.{name}", impossible=False, name=name, unit=unit, **sizes)


def _of_temperature(details: CertificateDetails) -> Iterator[Check]:
    at, low, high = details.environment.temperature_c, details.instrument.lowest_c, details.instrument.highest_c
    if at is None:
        return
    unfit = not low <= at <= high
    if unfit or not _USUAL_C[0] <= at <= _USUAL_C[1]:
        least, most = (low, high) if unfit else _USUAL_C
        name = "unfit_temperature" if unfit else "unusual_temperature"
        temperature = {"at_c": at, "least_c": least, "most_c": most}
        yield _found(name, "environment.temperature_c", impossible=unfit, **temperature)


def _of_repeatability(details: CertificateDetails, facts: CampaignFacts) -> Iterator[Check]:
    stated, found = details.robot.repeatability_mm, facts.repeatability_mm
    if stated is None:
        return
    low, high = _USUAL_REPEATABILITY_MM
    if not low <= stated <= high:
        sizes = {"stated_mm": stated, "least_mm": low, "most_mm": high}
        yield _found("unusual_repeatability", "robot.repeatability_mm", impossible=False, **sizes)
    if found is not None and not 1 / _REPEATABILITY_RATIO <= found / stated <= _REPEATABILITY_RATIO:
        sizes = {"stated_mm": stated, "found_mm": found}
        yield _found("other_repeatability", "robot.repeatability_mm", impossible=False, **sizes)


def _found(what: str, where: str, *, impossible: bool, **data: Any) -> Check:
    return Check(f"certificate.{what}", "failed" if impossible else "noted", data={"where": where, **data})


def _day(text: str) -> date | None:
    return date.fromisoformat(text) if text else None


def _names(name: str, text: str) -> bool:
    """Decide whether a text contains a name as whole words, its letters and digits however separated."""
    runs = re.findall(r"[a-z]+|\d+", name.lower())
    pattern = r"(?<![a-z0-9])" + r"[^a-z0-9]*".join(runs) + r"(?![a-z0-9])"
    return bool(runs) and re.search(pattern, text.lower()) is not None


def _shares_a_word(text: str, other: str) -> bool:
    """Decide whether two names share a word; where both have words with numbers, one of these."""
    words = [set(re.findall(r"[a-z]*\d+[a-z]*|[a-z]{2,}", each.lower())) for each in (text, other)]
    numbered = [{word for word in each if re.search(r"\d", word)} for each in words]
    first, second = numbered if all(numbered) else words
    return bool(first & second)
