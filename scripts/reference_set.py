"""Do two checkouts give the same answers? Forty commands run with both, and every number and decision compared."""

from lab.experiments.reference_set import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
