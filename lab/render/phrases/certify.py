"""Phrases of a certificate's checks: contradictions and unusual values."""

from collections.abc import Callable, Mapping

from lab.core.checks import Check

__all__ = ["PHRASES"]

_ITS = "the certificate of the {gauge}"
_TEMPLATES = {
    "certificate.other_day": "measured_on is {stated}, but the run was measured on {of_run}",
    "certificate.issued_before": (
        "the measurements of {measured_on} are later than the issue of the certificate on {issued}"
    ),
    "certificate.issued_late": (
        "the certificate of {issued} is issued {days:,} days after the measurements of {measured_on}"
    ),
    "certificate.ends_before_begin": f"{_ITS} of {{checked}} ends before it begins, on {{until}}",
    "certificate.later_than_issue": f"{_ITS} of {{checked}} is later than this certificate of {{issued}}",
    "certificate.no_day": f"{_ITS} ({{either}}) cannot be judged: the date of the measurements is not stated",
    "certificate.later_than_measured": f"{_ITS} of {{checked}} is later than {{of}}: its state then is unknown",
    "certificate.ended": f"{_ITS} ended on {{until}}, before {{of}}",
    "certificate.old": (
        f"{_ITS} of {{checked}} is {{years:.1f}} years older than {{of}}, and states no end (valid_until)"
    ),
    "certificate.other_robot": ("the certificate names the robot {stated}, but the run calibrates the model {of_run}"),
    "certificate.same_serial": "robot and instrument have the same serial number, {serial}",
    "certificate.other_instrument": (
        "the certificate names the instrument {stated}, but the run was weighted by the noise of {of_run}"
    ),
    "certificate.unfit_temperature": (
        "the temperature is {at_c:g} °C, but the instrument works from {least_c:g} to {most_c:g} °C"
    ),
    "certificate.unusual_temperature": (
        "the temperature is {at_c:g} °C, but robots are measured at {least_c:g} to {most_c:g} °C"
    ),
    "certificate.robot_temperature": (
        "the robot's temperature is stated within {spread_k:g} K, more than {most_k:g} K"
    ),
    "certificate.unusual_number": (
        "{name} is {value:g} {unit}, usual is {least:g} to {most:g} {unit}: is the unit right?"
    ),
    "certificate.unusual_repeatability": (
        "repeatability_mm is {stated_mm:g} mm, data sheets state {least_mm:g} to {most_mm:g} mm: is the unit right?"
    ),
    "certificate.other_repeatability": (
        "the repeatability is stated as {stated_mm:g} mm, but repeated poses show {found_mm:.2g} mm"
    ),
}


def _certificate(check: Check) -> str:
    data = dict(check.data)
    if "on" in data:
        data["of"] = f"{'the measurements' if data['measured'] else 'this certificate'} of {data['on']}"
    return _TEMPLATES[check.name].format(either=data.get("checked") or data.get("until"), **data)


PHRASES: Mapping[str, Callable[[Check], str]] = dict.fromkeys(_TEMPLATES, _certificate)
