"""The study of the catalogue of effects, on few arms; the whole study is slow."""

import pytest
from effect_catalogue import EFFECTS, NOISES, flexible_arm, rigid_arm


@pytest.mark.thorough
@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_is_found_alone(name: str) -> None:
    found = flexible_arm((name,), 1)
    assert not found.missing and not found.extras
    assert found.after < 1.3 * found.floor < 1e-5


@pytest.mark.thorough
@pytest.mark.parametrize("names", [("expansion", "drift"), ("compensator", "waves")])
def test_two_effects_are_told_apart(names: tuple[str, str]) -> None:
    """The second: waves that a gear's ratio names are searched first, else the spring is taken for single waves."""
    found = flexible_arm(names, 1)
    assert not found.missing and not found.extras


@pytest.mark.thorough
def test_errors_that_wander_are_no_effect() -> None:
    """Beside a drift that is fitted these errors wander less: only noise found without the drift refutes it."""
    assert rigid_arm("AR(1) 0.9", 29) == ()


@pytest.mark.slow
@pytest.mark.parametrize("name", NOISES)
def test_rigid_arms_are_given_nothing(name: str) -> None:
    assert sum(bool(rigid_arm(name, seed)) for seed in range(100)) <= 4  # of 1 %: less than 4 in 1,000 times
