"""Parallel robots calibrated: how many parameters show, how well positions come out, and what six true rods change."""

from lab.experiments.parallel_robots import Options
from lab.experiments.parallel_robots_answer import answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
