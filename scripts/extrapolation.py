"""Which calibrations hold where nothing was measured?"""

from lab.experiments.extrapolation import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
