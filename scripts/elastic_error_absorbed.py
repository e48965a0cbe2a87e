"""How much of the elastic error does a purely geometric calibration absorb?"""

from lab.experiments.elastic_absorption import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
