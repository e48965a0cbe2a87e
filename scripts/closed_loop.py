"""The loop closed: virtual arms are calibrated from designed poses, their targets corrected, run, and measured."""

from lab.experiments.closed_loop_study import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
