"""Flags as they are typed, from the options that differ from their defaults; and none of it needs numpy."""

import subprocess
import sys

from lab.calibration.observations.options import ObservationOptions, PoseOptions, SocketOptions, flags_given


def test_flags_are_told_as_they_are_typed() -> None:
    given = ObservationOptions(noise_mrad=0.0, method="sequential", socket_distance_mm=1.0)
    assert flags_given(given, PoseOptions) == ["--noise-mrad", "--method sequential"]
    assert flags_given(given, SocketOptions) == ["--socket-distance-mm"]
    assert flags_given(given, None) == flags_given(ObservationOptions(), PoseOptions) == []


def test_a_command_line_needs_no_kind() -> None:
    code = "import sys, lab.campaign.observation_kinds; print('numpy' in sys.modules)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "False"
