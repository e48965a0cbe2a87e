"""Which error source costs most? One at a time is added to a base case whose identifier knows nothing of it."""

from lab.experiments.error_sources import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
