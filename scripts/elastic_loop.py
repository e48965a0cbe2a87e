"""Are corrected targets and trajectories met by an arm with elastic links?"""

from lab.experiments.elastic_loop import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
