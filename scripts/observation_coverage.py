"""Every kind of observation on virtual arms: exact without noise, its noise floor, and its intervals against truth."""

from lab.experiments.observation_coverage import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
