"""The parameters of a virtual RX 130, identified from poses by the global and by the sequential method."""

from lab.experiments.rx130_parameters import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
