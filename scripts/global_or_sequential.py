"""Global, or sequential (angles first, lengths after)? Poses of virtual RX 130 arms, fitted both ways."""

from lab.experiments.global_or_sequential import Options
from lab.experiments.global_or_sequential_answer import answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
