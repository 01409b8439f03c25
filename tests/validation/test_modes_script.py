"""Modes from other seeds: what counts as agreeing, as seen and as missed."""

from blind.population import Population
from modes import table
from results import Origin

ORIGIN = Origin("command", "today", "commit", "machine")
CHECK = {"made": 1, "failed": 0, "higher": 0}


def pad(index, name, losses, seen, behind):
    return {
        "pad": name,
        "index": index,
        "hypothesis": "exponential, prony:2",
        "losses": losses,
        "seen": seen,
        "behind": behind,
        "checks": dict.fromkeys(("nested", "exchanged", "draws"), CHECK),
    }


def test_what_is_counted():
    pads = [
        pad(0, "bundled", [1.0, 1.2, 1.4], 1.0, 0.0),
        pad(2, "one set elsewhere", [5.0, 5.1, 9.0], 5.0, 0.0),
        pad(3, "not looked at, as it is improbable", [2.0, 2.0, 2.0], float("inf"), 7.0),
        pad(4, "not looked at, but the answer is no better", [3.0, 3.0, 3.0], float("inf"), -4.0),
        pad(6, "with an outsider", [1.0, 1.0, 1.0], 4.0, 0.0),
    ]
    text = table(pads, 1, Population(1), ORIGIN).markdown()
    assert "| 1 bundled | 3 of 3 (100%) | 1 | 1 of 1 (100%) | 0 | 0 |" in text
    assert "| 3 simulated, the true hypothesis | 8 of 9 (89%) | 2 | 1 of 3 (33%) | 1 | 1 |" in text
    assert "| 1 simulated with an outsider, the likeliest hypothesis | 3 of 3 (100%)" in text
    assert "nested made 5 times, failed 0" in text
