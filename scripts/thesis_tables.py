"""Which criterion should choose the poses? A thesis' tables done again, and paired simulated calibrations."""

from lab.experiments.criteria_study import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
