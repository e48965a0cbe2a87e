"""Options of campaigns: what is refused before anything is computed."""

from dataclasses import fields, replace

import pytest

from lab.core.errors import LabError
from lab.options.option_groups import Effects, Fitting
from lab.options.virtual_campaign import DesignOptions, VirtualCampaign, check_common, check_region


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
    check_common(Fitting(), 0, 1.0, None, None, None)
    for flag, given in {"--seed": (-1, 1.0, None), "--gate-mm": (0, 0.0, None), "--noise-mm": (0, 1.0, -1.0)}.items():
        with pytest.raises(LabError, match=flag):
            check_common(Fitting(), *given, None, None)


@pytest.mark.parametrize("region", ["elsewhere", "1,2,3", "0,1,0,1,0,nan", "0,1,0,1,1,0", "task.txt", ""])
def test_a_region_is_a_word_a_box_or_a_file_of_targets(region: str) -> None:
    with pytest.raises(LabError, match="--region"):
        replace(VirtualCampaign(), region=region).check()
    replace(VirtualCampaign(), region="-100,100,0,200,300,400").check()


def test_a_region_is_of_measured_positions() -> None:
    check_region("measured", VirtualCampaign(observe="cable", instrument="draw-wire").kind())
    with pytest.raises(LabError, match="--region workspace: of --observe cable errors are predicted where"):
        replace(VirtualCampaign(observe="cable", instrument="draw-wire"), region="workspace").check()
