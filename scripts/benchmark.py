"""How fast the lab is: medians on one thread, and the ratio to scipy with finite differences in the same run."""

from lab.experiments.script import run_script
from lab.experiments.speed import Options, answer

if __name__ == "__main__":
    run_script(Options, answer)
