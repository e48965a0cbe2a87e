"""What share of an arm's position error is geometric? Virtual arms with other errors beside, at several levels."""

from lab.experiments.geometric_share import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
