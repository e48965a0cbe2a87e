"""How fast the lab is: medians of processor time on one thread, and their ratios to a yardstick run in between.

python scripts/benchmark.py [--history FILE]
"""

from lab.experiments.script import run_script
from lab.experiments.speed import Options, answer

if __name__ == "__main__":
    run_script(Options, answer)
