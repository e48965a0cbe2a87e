"""Counts in sentences."""

from lab.core.errors import be, counted


def test_one_is_and_others_are() -> None:
    assert f"{counted(1, 'pose')} {be(1)} left" == "1 pose is left"
    assert f"{counted(0, 'pose')} {be(0)} left" == "0 poses are left"
    assert f"{counted(12345, 'pose')} {be(12345)} left" == "12,345 poses are left"
