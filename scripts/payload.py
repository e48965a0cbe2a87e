"""Which method identifies a payload best: torques along a path, or a wrist sensor?"""

from lab.experiments.payload_methods import Options
from lab.experiments.payload_methods_answer import answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
