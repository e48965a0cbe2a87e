"""The error of the lab, its context, and the numbers and names that raise it."""

import pytest

from lab.core import significance
from lab.core.errors import LabError, error_context
from lab.core.limits import POSES, POSITIVE_OPTION, positive, whole
from lab.core.orientation import ANGLE_CONVENTIONS


def test_an_error_gets_its_context_before_it() -> None:
    with pytest.raises(LabError, match=r"^outer: inner: what$"), error_context("outer"), error_context("inner"):
        raise LabError("what")


def test_other_errors_pass_as_they_are() -> None:
    with pytest.raises(KeyError, match="what"), error_context("outer"):
        raise KeyError("what")


@pytest.mark.parametrize(
    "value", [0.0, -1.0, POSITIVE_OPTION.least / 2, 2 * POSITIVE_OPTION.most, float("nan"), float("inf")]
)
def test_what_is_not_above_zero_is_refused(value: float) -> None:
    with pytest.raises(LabError, match="--noise-mm"):
        positive("--noise-mm", value)


def test_numbers_at_the_ends_are_taken() -> None:
    positive("--noise-mm", POSITIVE_OPTION.least)
    positive("--noise-mm", POSITIVE_OPTION.most)
    whole("--poses", 5, 5, POSES)
    with pytest.raises(LabError, match=r"--poses 4: .* 5 or more"):
        whole("--poses", 4, 5, POSES)


def test_every_level_is_a_small_chance() -> None:
    assert all(0 < getattr(significance, name) <= 0.05 for name in significance.__all__)


def test_conventions_of_angles_have_their_names() -> None:
    assert ANGLE_CONVENTIONS == ("intrinsic-xyz", "fixed-xyz", "rotation-vector")
