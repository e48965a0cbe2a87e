"""How well are an arm's dynamic parameters identified, and what is told of what biases them?"""

from lab.experiments.arm_dynamics import Options
from lab.experiments.arm_dynamics_answer import answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
