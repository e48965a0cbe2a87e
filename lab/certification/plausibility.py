"""Check what a certificate states beside its numbers: dates, names, surroundings.

Some details cannot be true together: a measurement after the certificate's issue, an instrument whose certificate had
ended, another robot's name. Such a certificate is not issued. Others can be true and are unusual: they are named.
Nothing depends on the day on which the certificate is made.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date

from lab.formats.certificate_toml import CertificateDetails
from lab.formats.programs.registry import language_of_maker

__all__ = ["CampaignFacts", "Implausibility", "implausibilities"]

USUAL_C = (15.0, 35.0)  # of a hall in which robots are measured
LONGEST_YEARS = 2.0  # between two calibrations of an instrument, where its certificate states no end
LONGEST_DAYS_TO_ISSUE = 365  # from the measurements to the certificate
USUAL_PRESSURE_HPA = (700.0, 1080.0)  # from 3,000 m up to the highest at sea level
MOST_HUMID_PERCENT = 90.0  # above, water condenses on cooler glass
USUAL_EXPANSION_PPM = (1.0, 30.0)  # from carbon fibre to aluminium alloys
MOST_ROBOT_KELVIN = 30.0  # by which a working robot is warmer than its surroundings
USUAL_REPEATABILITY_MM = (1e-3, 1.0)  # RP that data sheets of robots state
REPEATABILITY_RATIO = 3.0  # of the measured to the stated one, either way
_YEAR = 365.25  # days


@dataclass(frozen=True)
class CampaignFacts:
    """What a run itself shows of what a certificate's details state.

    Attributes:
        robot: the name of the robot's model.
        instrument: the preset by whose noise the run was weighted; "" where it is none.
        measured_on: the day of the measurements by the run's option, "" where it has none.
        repeatability_mm: RP as measured; None where no pose was repeated.
    """

    robot: str
    instrument: str = ""
    measured_on: str = ""
    repeatability_mm: float | None = None


@dataclass(frozen=True)
class Implausibility:
    """A detail that cannot be right, or is unusual.

    Attributes:
        where: the details' section and name.
        words: what is wrong, in one sentence.
        impossible: whether no certificate can be issued with it.
    """

    where: str
    words: str
    impossible: bool


def implausibilities(details: CertificateDetails, facts: CampaignFacts) -> tuple[Implausibility, ...]:
    """Check all details of a certificate against each other and against the run."""
    return (
        *_of_dates(details, facts),
        *_of_robot(details, facts),
        *_of_instrument(details, facts),
        *_of_surroundings(details),
        *_of_repeatability(details, facts),
    )


def _of_dates(details: CertificateDetails, facts: CampaignFacts) -> Iterator[Implausibility]:
    """Order the days of calibration, measurement and issue."""
    stated, issued = _day(details.certificate.measured_on or facts.measured_on), _day(details.certificate.date)
    if details.certificate.measured_on and facts.measured_on and facts.measured_on != details.certificate.measured_on:
        words = f"measured_on is {details.certificate.measured_on}, but the run was measured on {facts.measured_on}"
        yield Implausibility("certificate.measured_on", words, True)
    if stated and issued and stated > issued:
        words = f"the measurements of {stated} are later than the issue of the certificate on {issued}"
        yield Implausibility("certificate.date", words, True)
    if stated and issued and (issued - stated).days > LONGEST_DAYS_TO_ISSUE:
        days = (issued - stated).days
        words = f"the certificate of {issued} is issued {days:,} days after the measurements of {stated}"
        yield Implausibility("certificate.date", words, False)
    for name, gauge in (("instrument", details.instrument), ("reflector", details.reflector)):
        yield from _of_certificate(name, _day(gauge.certificate_date), _day(gauge.valid_until), stated, issued)


def _of_certificate(
    name: str, checked: date | None, until: date | None, measured: date | None, issued: date | None
) -> Iterator[Implausibility]:
    """Check the certificate of an instrument or a reflector: it has to hold on the day of the measurements."""
    where, its = f"{name}.certificate_date", f"the certificate of the {name}"
    if checked and until and until < checked:
        words = f"{its} of {checked} ends before it begins, on {until}"
        yield Implausibility(f"{name}.valid_until", words, True)
        return
    if checked and issued and checked > issued:
        yield Implausibility(where, f"{its} of {checked} is later than this certificate of {issued}", True)
    on = measured or issued
    if on is None:
        if checked or until:
            words = f"{its} ({checked or until}) cannot be judged: no day of the measurements is stated"
            yield Implausibility(where, words, True)
        return
    of = f"the measurements of {on}" if measured else f"this certificate of {on}"
    if checked and measured and checked > measured:
        yield Implausibility(where, f"{its} of {checked} is later than {of}: nothing says how it was then", True)
    if until and until < on:
        yield Implausibility(f"{name}.valid_until", f"{its} ended on {until}, before {of}", True)
    if checked and not until and (on - checked).days > LONGEST_YEARS * _YEAR:
        years = (on - checked).days / _YEAR
        words = f"{its} of {checked} is {years:.1f} years older than {of}, and states no end (valid_until)"
        yield Implausibility(where, words, True)


def _of_robot(details: CertificateDetails, facts: CampaignFacts) -> Iterator[Implausibility]:
    robot = details.robot
    stated = f"{robot.maker} {robot.model}".strip()
    makers = language_of_maker(stated), language_of_maker(facts.robot)
    other = robot.model and not (_names(robot.model, facts.robot) or _names(facts.robot, stated))
    if other or (None not in makers and makers[0] is not makers[1]):
        words = f"the certificate is of a robot {stated}, but the run calibrates the model {facts.robot}"
        yield Implausibility("robot.model", words, makers[1] is not None)
    if robot.serial_number and robot.serial_number == details.instrument.serial_number:
        words = f"robot and instrument have the same serial number, {robot.serial_number}"
        yield Implausibility("robot.serial_number", words, True)


def _of_instrument(details: CertificateDetails, facts: CampaignFacts) -> Iterator[Implausibility]:
    stated = f"{details.instrument.maker} {details.instrument.model}".strip()
    known = facts.instrument
    if details.instrument.model and known and not _shares_a_word(stated, known):
        words = f"the certificate is of an instrument {stated}, but the run was weighted by the noise of {known}"
        yield Implausibility("instrument.model", words, False)


def _of_surroundings(details: CertificateDetails) -> Iterator[Implausibility]:
    room, low, high = details.environment, details.instrument.lowest_c, details.instrument.highest_c
    if (at := room.temperature_c) is not None:
        unfit = not low <= at <= high
        if unfit or not USUAL_C[0] <= at <= USUAL_C[1]:
            range_words = f"the instrument works from {low:g} to {high:g} °C"
            usual = f"robots are measured at {USUAL_C[0]:g} to {USUAL_C[1]:g} °C"
            words = f"the temperature is {at:g} °C, but {range_words if unfit else usual}"
            yield Implausibility("environment.temperature_c", words, unfit)
    if (known := details.robot_temperature) is not None:
        spread = min(known[0].limit, 2 * known[0].standard)
        if spread > MOST_ROBOT_KELVIN:
            words = f"the robot's temperature is stated within {spread:g} K, more than {MOST_ROBOT_KELVIN:g} K"
            yield Implausibility("environment.robot_temperature_k", words, False)
    numbers: dict[str, tuple[float | None, tuple[float, float], str]] = {
        "expansion_ppm_per_k": (room.expansion_ppm_per_k, USUAL_EXPANSION_PPM, "ppm/K"),
        "pressure_hpa": (room.pressure_hpa, USUAL_PRESSURE_HPA, "hPa"),
        "humidity_percent": (room.humidity_percent, (0.0, MOST_HUMID_PERCENT), "%"),
    }
    for name, (value, (least, most), unit) in numbers.items():
        if value is not None and not least <= value <= most:
            words = f"{name} is {value:g} {unit}, usual is {least:g} to {most:g} {unit}: is the unit right?"
            yield Implausibility(f"environment.{name}", words, False)


def _of_repeatability(details: CertificateDetails, facts: CampaignFacts) -> Iterator[Implausibility]:
    stated, found = details.robot.repeatability_mm, facts.repeatability_mm
    if stated is None:
        return
    low, high = USUAL_REPEATABILITY_MM
    if not low <= stated <= high:
        words = f"repeatability_mm is {stated:g} mm, data sheets state {low:g} to {high:g} mm: is the unit right?"
        yield Implausibility("robot.repeatability_mm", words, False)
    if found is not None and not 1 / REPEATABILITY_RATIO <= found / stated <= REPEATABILITY_RATIO:
        words = f"the repeatability is stated as {stated:g} mm, but repeated poses show {found:.2g} mm"
        yield Implausibility("robot.repeatability_mm", words, False)


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
