"""Options of campaigns: what is refused before anything is computed."""

import ast
import inspect
import re
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import lab
from lab.core.errors import LabError
from lab.options.call_options import options_of
from lab.options.command_options import VerifyOptions
from lab.options.judging import Judging, ValidatedJudging
from lab.options.measured_campaign import MeasuredCampaign
from lab.options.option_groups import Effects, Fitting
from lab.options.option_texts import field_texts
from lab.options.virtual_campaign import DesignOptions, VirtualCampaign, check_common
from lab.sensors.points import PointSensor


@pytest.mark.parametrize("options", [VirtualCampaign(), Fitting(), Effects()])
def test_the_defaults_are_good(options: VirtualCampaign | Fitting | Effects) -> None:
    options.check()


@pytest.mark.parametrize("name", [each.name for each in fields(VirtualCampaign) if each.type in (int, float)])
def test_a_number_below_zero_is_refused_by_its_flag(name: str) -> None:
    flag = f"--{name.replace('_', '-')}"
    with pytest.raises(LabError, match=flag):
        replace(VirtualCampaign(), **{name: -1}).check()


def test_the_defaults_of_a_design_are_good() -> None:
    DesignOptions().refuse_nonsense()


def test_two_sizes_of_a_design_are_one_too_many() -> None:
    with pytest.raises(LabError, match="--poses and --accuracy-mm"):
        DesignOptions(poses=20, accuracy_mm=0.01).refuse_nonsense()
    with pytest.raises(LabError, match="--accuracy-mm"):
        DesignOptions(accuracy_mm=0.0).refuse_nonsense()


@pytest.mark.parametrize("model", ["", "gear+gear", "gear+"])
def test_groups_are_different_names(model: str) -> None:
    with pytest.raises(LabError, match="--model"):
        Fitting(model).check()


def test_groups_of_a_model() -> None:
    assert Fitting().groups == Fitting("auto").groups == ()
    assert Fitting("gear+backlash").groups == Fitting("geometric+gear+backlash").groups == ("gear", "backlash")


def test_what_all_campaigns_share_is_checked_once() -> None:
    check_common(Fitting(), 0, None, None, None)
    for flag, given in {"--seed": (-1, None), "--noise-mm": (0, -1.0)}.items():
        with pytest.raises(LabError, match=flag):
            check_common(Fitting(), *given, None, None)


@pytest.mark.parametrize(
    ("judging", "says"),
    [
        (ValidatedJudging(gate_mm=0.0), "--gate-mm"),
        (ValidatedJudging(holdout=0.2, holdout_last=0.2), "--holdout and --holdout-last both"),
        (ValidatedJudging(holdout=0.2, validate=Path("a.csv")), "--holdout and --validate both"),
        (ValidatedJudging(refit=("base",)), "--refit"),
    ],
)
def test_a_judgement_that_contradicts_itself_is_refused(judging: ValidatedJudging, says: str) -> None:
    ValidatedJudging(gate_mm=1.0, validate=Path("a.csv"), refit=("base",)).check_judging(PointSensor())
    with pytest.raises(LabError, match=says):
        judging.check_judging(PointSensor())


def test_a_judgement_is_in_si_units() -> None:
    found = ValidatedJudging(gate_mm=0.25, region="0,1000,0,1000,0,1000", holdout=0.2).judgement()
    assert found.gate_m == 0.25e-3 and found.region.kind == "box" and found.holdout == 0.2 and found.other is None
    assert Judging().judgement().gate_m is None


@pytest.mark.parametrize("kind", [VirtualCampaign, MeasuredCampaign, Fitting, Effects, DesignOptions, VerifyOptions])
def test_the_text_below_each_field_is_that_of_the_syntax_tree(kind: type) -> None:
    for base in kind.__mro__[:-1]:
        (tree,) = ast.parse(inspect.getsource(base)).body
        written = {
            one.target.id: after.value.value
            for one, after in pairwise(tree.body)
            if isinstance(one, ast.AnnAssign)
            and isinstance(getattr(after, "value", None), ast.Constant)
            and isinstance(after, ast.Expr)
        }
        assert written.items() <= field_texts(base).items()


@pytest.mark.parametrize("name", ["simulate", "calibrate", "identify", "design", "verify", "predict", "workspace"])
def test_help_has_every_option_of_a_call_with_its_meaning(name: str) -> None:
    call = getattr(lab, name)
    section = inspect.getdoc(call).partition("\nOptions:\n")[2]
    described = dict(re.findall(r"^    (\w+) \(.*?\): ((?:.|\n(?=     ))+)", section, re.MULTILINE))
    own = inspect.signature(inspect.unwrap(call)).parameters
    options = set(inspect.signature(call).parameters) - set(own)
    assert options == set(described) and all(len(text) > 15 for text in described.values())


_NUMPY = {"poses": np.int64(20), "seed": np.uint8(7), "gate_mm": np.float32(0.5), "robust": np.bool_(True),
          "targets": np.array(["p1", "p2"]), "fix": ["link4.d"], "instrument": "exact"}  # fmt: skip


def test_options_are_plain_values_whatever_holds_them() -> None:
    plain = {"poses": 20, "seed": 7, "gate_mm": 0.5, "robust": True, "targets": ("p1", "p2"), "fix": ("link4.d",),
             "instrument": "exact"}  # fmt: skip
    assert options_of("call", VirtualCampaign, _NUMPY) == options_of("call", VirtualCampaign, plain)
    text = options_of("call", VirtualCampaign, {"targets": "p1, p2", "region": Path("a/b.csv"), "cell": "c.toml"})
    assert (text.targets, text.region, text.cell) == (("p1", "p2"), "a/b.csv", Path("c.toml"))


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("poses", np.float64(20.5)),
        ("poses", np.array([20, 21])),
        ("poses", np.bool_(True)),
        ("gate_mm", "0.5"),
        ("gate_mm", 1j),
        ("targets", np.array([1, 2])),
        ("targets", 3),
        ("robust", 1),
        ("cell", 3.0),
        ("instrument", 5),
    ],
)
def test_a_value_of_another_type_is_refused_in_one_line(option: str, value: object) -> None:
    with pytest.raises(LabError) as refused:
        lab.simulate("irb120", **{option: value}) if option != "gate_mm" and option != "robust" else lab.calibrate(
            "irb120", **{option: value}
        )
    assert option in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize("region", ["elsewhere", "1,2,3", "0,1,0,1,0,nan", "0,1,0,1,1,0", "task.txt", ""])
def test_a_region_is_a_word_a_box_or_a_file_of_targets(region: str) -> None:
    with pytest.raises(LabError, match="--region"):
        replace(VirtualCampaign(), region=region).check()
    replace(VirtualCampaign(), region="-100,100,0,200,300,400").check()


def test_a_region_is_of_measured_positions() -> None:
    VirtualCampaign(observe="cable", instrument="draw-wire").check()
    with pytest.raises(LabError, match="--region workspace: of --observe cable errors are predicted where"):
        replace(VirtualCampaign(observe="cable", instrument="draw-wire"), region="workspace").check()
