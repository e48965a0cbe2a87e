"""A certificate's file: what it says, what it misses, and one line for what makes no sense."""

from pathlib import Path

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.formats.certificate_toml import CertificateDetails, read_certificate_details

WHOLE = """
[certificate]
number = "42"
date = 2026-03-31
issued_by = "Us"
operator = "A"
place = "Hall 3"
[robot]
serial_number = "R1"
repeatability_mm = 0.01
[instrument]
serial_number = "T1"
certificate = "C1"
certificate_date = "2025-11-02"
[reflector]
serial_number = "S1"
[environment]
temperature_c = 20.5
robot_temperature_k = { limit = 1.5 }
expansion_ppm_per_k = 12
"""


def read(text: str, folder: Path) -> CertificateDetails:
    path = folder / "details.toml"
    path.write_text(text)
    return read_certificate_details(path)


def test_a_whole_file_misses_nothing(tmp_path: Path) -> None:
    details = read(WHOLE, tmp_path)
    assert details.missing == () and details.certificate.date == "2026-03-31"
    kelvin, expansion = details.robot_temperature or (None, 0.0)
    assert kelvin is not None and kelvin.standard == pytest.approx(1.5 / np.sqrt(3)) and expansion == 12e-6
    assert details.to_dict()["robot"] == {"serial_number": "R1", "repeatability_mm": 0.01}


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    details = read(WHOLE.replace('operator = "A"\n', "").replace('[reflector]\nserial_number = "S1"\n', ""), tmp_path)
    assert details.missing == ("certificate.operator", "reflector.serial_number")
    assert len(CertificateDetails().missing) == 10 and CertificateDetails().robot_temperature is None


WRONG = {
    "[robots]\n": r"\[robots\]: unknown; valid are \[certificate\]",
    "robot = 3\n": "is to be a section",
    "[robot]\ncolour = 'red'\n": "colour",
    "[robot]\nserial_number = 7\n": "give a text",
    "[robot]\nserial_number = ' '\n": "one line of 1 to 200",
    '[robot]\nserial_number = "a\\nb"\n': "one line of 1 to 200",
    f"[robot]\nserial_number = '{'x' * 201}'\n": "one line of 1 to 200",
    "[robot]\nrepeatability_mm = 0\n": "repeatability_mm 0: give a number above zero",
    "[certificate]\ndate = '31.3.2026'\n": "write it as 2026",
    "[certificate]\ndate = '2026-02-30'\n": "write it as 2026",
    "[environment]\ntemperature_c = 293\n": "give degrees Celsius",
    "[environment]\nhumidity_percent = 120\n": "give 0 to 100",
    "[environment]\nrobot_temperature_k = { limit = 1 }\n": "go together",
    "[environment]\nrobot_temperature_k = { limit = 1, freedom = 9 }\nexpansion_ppm_per_k = 12\n": "freedom goes",
}


@pytest.mark.parametrize(("text", "said"), WRONG.items(), ids=range(len(WRONG)))
def test_what_makes_no_sense_is_one_line(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(LabError, match=said) as caught:
        read(text, tmp_path)
    assert "details.toml" in str(caught.value) and "\n" not in str(caught.value)
