"""What accuracy does an instrument buy, and how many poses make up for a cheaper one?"""

from lab.experiments.accuracy_versus_instrument import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
