"""The pictures of recordings in README and pages, made again: each from the command beside it."""

from lab.experiments.recording_pictures import Options, answer
from lab.experiments.script import run_script

if __name__ == "__main__":
    run_script(Options, answer)
