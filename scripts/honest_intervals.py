"""Are the intervals honest? Thousands of virtual campaigns against the truth, for every kind of noise."""

from lab.experiments.interval_coverage import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
