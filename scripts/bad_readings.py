"""Bad readings: how much a few poses that are off cost a calibration, and how often they are named."""

from lab.experiments.outlier_detection import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
