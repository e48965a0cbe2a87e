"""Does a certificate's 95 % cover the true error?"""

from lab.experiments.certificate_coverage import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
