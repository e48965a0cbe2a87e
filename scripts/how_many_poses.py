"""How many poses are enough: predicted accuracy against their number, with O1 beside it (thesis fig. IV.1)."""

from lab.experiments.pose_count import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
