"""Are bending links found by ``--model auto``, and only where they are?"""

from lab.experiments.elastic_link_detection import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
