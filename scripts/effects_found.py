"""Are compliance and runout of the joints found by ``--model auto``, and only where they are?"""

from lab.experiments.effect_detection import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
