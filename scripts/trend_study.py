"""Does `lab trend` keep its level over a year, and does it name a joint whose zero has moved? Virtual years."""

from lab.experiments.script import run_script
from lab.experiments.trend_study import Options, answer

if __name__ == "__main__":
    run_script(Options, answer)
