"""Does a verification notice what has moved, and name it? Virtual arms, each calibrated, then measured at new poses."""

from lab.experiments.script import run_script
from lab.experiments.verification_power import Options, answer

if __name__ == "__main__":
    run_script(Options, answer)
