"""What do a dozen arms take over two years, and are their changes found? Virtual arms, by the public calls."""

from lab.experiments.operations_year import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
