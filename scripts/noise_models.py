"""Do intervals, outliers and verifications hold under other noise than the instrument's?"""

from lab.experiments.noise_models import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
