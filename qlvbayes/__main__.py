"""``python -m qlvbayes``: the command line."""

from qlvbayes.cli.main import run

if __name__ == "__main__":
    run()
