"""An engineer's day with a UR5e: cell, plan, measurements as files, calibration, a corrected program, verification."""

from lab.experiments.engineers_day import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
