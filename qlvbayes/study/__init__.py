"""The steps of a study with the files that each leaves, and all of them in one go."""

from qlvbayes.study.run import run_study
from qlvbayes.study.watcher import Watcher

__all__ = ["Watcher", "run_study"]
