"""When is which model worth its poses? The error at held-out poses against the number of measured ones."""

from lab.experiments.learning_curve import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
