"""The best O1 of a thesis' case (Mahdadi & Bouafia, 2020, fig. IV.2)."""

from lab.experiments.best_o1 import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
