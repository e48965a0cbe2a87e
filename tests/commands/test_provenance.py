"""What every page says of how its result came about."""

from pathlib import Path

from lab.library.run_folder import command_line
from lab.options.command_options import HistoryOptions
from lab.options.compensation import CompensateOptions
from lab.options.measured_campaign import MeasuredCampaign
from lab.options.option_groups import Effects, Fitting
from lab.options.virtual_campaign import VirtualCampaign


def test_a_command_line_gives_the_options_back(tmp_path: Path, capsys) -> None:
    assert command_line("calibrate", VirtualCampaign()) == "lab calibrate"
    effects, fitting = (
        Effects(payload_kg=(0.0, 3.0), bad_share=0.05),
        Fitting(robust=True, fix=("link4.d", "tool.*")),
    )
    told = command_line("calibrate", VirtualCampaign(seed=3, effects=effects, fitting=fitting))
    assert told == "lab calibrate --seed 3 --robust --fix 'link4.d,tool.*' --payload-kg 0,3 --bad-share 0.05"
    told = command_line("identify", MeasuredCampaign(Path("a b.csv"), holdout=0.3, refit=("base",)))
    assert told == "lab identify 'a b.csv' --holdout 0.3 --refit base"
    assert command_line("compensate", CompensateOptions(Path("run"), Path("t.csv"))) == "lab compensate t.csv --run run"


def test_several_words_without_a_flag_stand_side_by_side() -> None:
    told = command_line("history", HistoryOptions((Path("a b"), Path("c"))))
    assert told == "lab history 'a b' c"
