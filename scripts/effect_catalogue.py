"""Are effects found that virtual arms have, alone and in pairs, and nothing in rigid arms, whatever their noise?"""

from lab.experiments.effect_catalogue import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
