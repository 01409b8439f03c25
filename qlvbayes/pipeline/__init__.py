"""The steps of a study with the files that each leaves, and all of them in one go."""

from qlvbayes.pipeline.run import run_study
from qlvbayes.pipeline.watcher import Watcher

__all__ = ["Watcher", "run_study"]
