"""How often is the verdict wrong? Virtual campaigns of known quality."""

from lab.experiments.script import run_script
from lab.experiments.verdict_quality import Options, answer

if __name__ == "__main__":
    run_script(Options, answer)
