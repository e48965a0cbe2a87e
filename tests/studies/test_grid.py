"""The grid of a study: what its factors may name, in one line where they may not."""

from pathlib import Path

import pytest

from lab.core.errors import LabError
from lab.studies.campaigns import refuse_impossible
from lab.studies.grid import ANY, FACTORS, OF_PLAN, GridCell, Study, is_any, read_study, study_from


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"colour": ["red"]}, "factor 'colour' is unknown; there are criterion, "),
        ({"model": ["rust"]}, "--model rust: no such group; there are geometric, auto, compliance"),
        ({"model": ["compliance+compliance"]}, r"factors: --model compliance\+compliance: give geometric, auto, or"),
        ({"model": [3]}, "factors: 'model' is 3; give a name, or a lab"),
        ({"robust": ["yes"]}, "factors: 'yes' is not a value of option 'robust'; give true or false"),
        ({"prior": ["maybe"]}, "factors: 'maybe' is not a value of option 'prior'; give one of auto, on, off"),
        ({"observe": ["colour"]}, "factors: --observe colour: unknown; give one of points, pose"),
        ({"plan": ["not-there.csv"]}, "factor plan: not-there.csv: cannot be read"),
        ({"targets": [0]}, "factor targets 0: give a whole number of 1 or more"),
        ({"targets": [7]}, "factor targets 7: robot irb120 has 3: p1, p2, p3"),
        ({"payload_kg": [-1]}, "--payload-kg -1: give a number from 0"),
        ({"payload_kg": ["heavy"]}, "is not a value of option 'payload_kg'; give a list, each a number"),
        ({"sampler": ["dice"]}, "factors: --sampler dice: unknown; give one of normal"),
        ({"estimator": ["oracle"]}, "factors: --estimator oracle: unknown; give one of least-squares"),
        ({"poses": [13], "model": ["compliance+harmonics"]}, "13 poses cannot show the parameters: give 14 or more"),
    ],
)
def test_a_level_that_cannot_be_is_refused_in_one_line(factors: dict[str, list[object]], words: str) -> None:
    with pytest.raises(LabError, match=words) as error:
        refuse_impossible(study_from({"factors": {"criterion": "random", **factors}}))
    assert "\n" not in str(error.value)


def test_a_set_of_parameters_leaves_to_the_factors_what_is_theirs() -> None:
    content = {"factors": {"criterion": "random", "parameters": "few"}, "parameters": {"few": {"robust": True}}}
    with pytest.raises(LabError, match=r"parameters.few: give model, robust, prior and estimator in \[factors\]"):
        refuse_impossible(study_from(content))


def test_payloads_of_a_factor_and_of_its_effects_are_not_both() -> None:
    content = {"factors": {"effects": "soft", "payload_kg": 2.0}, "effects": {"soft": {"payload_kg": [0.0, 3.0]}}}
    with pytest.raises(LabError, match=r"factor payload_kg: \[effects.soft\] has payload_kg, too; keep one"):
        study_from(content)


def test_frozen_is_of_campaigns_that_are_fitted_together() -> None:
    with pytest.raises(LabError, match="frozen: campaigns that are identified one by one have no common Jacobian"):
        refuse_impossible(study_from({"frozen": True, "factors": {"criterion": "random", "robust": True}}))


@pytest.mark.parametrize(
    ("cell", "together"),
    [
        (GridCell(), True),
        (GridCell(model="compliance+harmonics"), True),
        (GridCell(model="auto"), False),
        (GridCell(model="geometric+residual"), False),
        (GridCell(model="sessions"), False),
        (GridCell(robust=True), False),
        (GridCell(prior="auto"), False),
        (GridCell(observe="pose"), False),
        (GridCell(estimator="mine"), False),
    ],
)
def test_campaigns_of_least_squares_alone_are_fitted_together(cell: GridCell, together: bool) -> None:
    assert cell.is_stacked == together


def test_a_plan_has_its_poses_whatever_chooses_others() -> None:
    factors = {"plan": ("none", "plan.csv"), "criterion": ("random", "O5"), "poses": (12, 20)}
    cells = Study(factors=factors).cells
    planned = [cell for cell in cells if cell.plan == "plan.csv"]
    assert len(cells) == 5 and planned == [GridCell(criterion=ANY, scaling=ANY, poses=OF_PLAN, plan="plan.csv")]
    assert [name for name in FACTORS if is_any(name, getattr(planned[0], name))] == ["criterion", "scaling", "poses"]


def test_payloads_are_read_as_one_or_as_several(tmp_path: Path) -> None:
    path = tmp_path / "grid.toml"
    path.write_text("[factors]\npayload_kg = [0, [0, 3]]\ntargets = [1, 2]\n")
    study = read_study(path)
    assert study.factors["payload_kg"] == ((0.0,), (0.0, 3.0)) and [cell.targets for cell in study.cells] == [
        1,
        1,
        2,
        2,
    ]
    assert study.effects_of(study.cells[-1]).payload_kg == (0.0, 3.0)
    with pytest.raises(LabError, match=r"factor payload_kg: 3.0 is no tuple; give one for each level"):
        Study(factors={"payload_kg": (3.0,)})
    assert {cell.targets for cell in Study(targets=("p1", "p3")).cells} == {2}


@pytest.mark.parametrize(
    "factors",
    [
        {"payload_kg": [[0, 3], [3, 0]]},
        {"model": ["compliance+harmonics", "harmonics+compliance"]},
        {"observe": ["points+cable", "cable+points"]},
    ],
)
def test_levels_that_differ_in_their_order_alone_are_one(factors: dict[str, list[object]]) -> None:
    with pytest.raises(LabError, match="give at least one value, and each once"):
        study_from({"factors": factors})


def test_payloads_of_a_rigid_arm_are_refused() -> None:
    """They would change no measured point, and no model that is fitted."""
    rigid = {"criterion": "random", "payload_kg": [3]}
    with pytest.raises(LabError, match="payload_kg: a rigid arm does not deflect under a load"):
        refuse_impossible(study_from({"factors": rigid}))
    backlash = {"factors": {**rigid, "effects": ["loose"]}, "effects": {"loose": {"backlash_mrad": 0.1}}}
    with pytest.raises(LabError, match=r"payload_kg: \[effects.loose\] does not deflect under a load"):
        refuse_impossible(study_from(backlash))
    refuse_impossible(study_from({"factors": {**rigid, "model": ["compliance"]}}))
    soft = {"factors": {**rigid, "effects": ["soft"]}, "effects": {"soft": {"stiffness_nm_per_rad": 1e5}}}
    refuse_impossible(study_from(soft))
