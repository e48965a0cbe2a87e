"""The geometric share of an arm's error: a few campaigns of it, its effects at a level, and where 95 % holds."""

from pathlib import Path

import geometric_share
import pytest
from geometric_share import effects_at
from helpers.run_script import answer_of

from lab.options.option_groups import Effects


def test_effects_grow_with_the_level() -> None:
    soft = Effects(stiffness_nm_per_rad=1e5, payload_kg=(0.0, 3.0))
    assert effects_at(soft, 2.0) == {"stiffness_nm_per_rad": 5e4, "payload_kg": (0.0, 3.0)}
    assert effects_at(Effects(backlash_mrad=0.05), 4.0) == {"backlash_mrad": pytest.approx(0.2)}


@pytest.mark.slow
def test_a_few_arms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The share falls with the level; what is left grows as the effects do, and without them it is the noise."""
    monkeypatch.setattr(geometric_share, "LEVELS", (1.0, 4.0))
    found = answer_of("geometric_share.py", "--robots", 3, "--draws", 1, "--workers", 1, "--out", tmp_path)
    by = {(row["source"], row["level"]): row for row in found["shares"]}
    assert by["none", 0.0]["share"] > 0.998 and by["none", 0.0]["after_mm"] < 0.006
    for source in (*geometric_share.SOURCES, geometric_share.ALL):
        small, large = by[source, 1.0], by[source, 4.0]
        assert small["share"] > large["share"] and small["of_square"] > small["share"]
        assert 2 < large["after_mm"] / small["after_mm"] < 4.5  # the noise is the same in both
        assert by[geometric_share.ALL, 1.0]["after_mm"] > 0.99 * small["after_mm"]
