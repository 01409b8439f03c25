"""Count the cases of `design_cases` and what is asked of them, by rules fixed before a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

SLOPE = (0.8, 1.2)  # asked of realised over expected bits
RATIO = 2.0  # asked of the proposed over the standard test's fall of the worst sd a minute
RESOLVED = 0.8  # share of ambiguous pads that one proposed test should resolve rightly
SURE = 0.9  # probability from which a cause counts as found
OPEN = 0.5  # P(outside) before the test, from which a pad is one that the design should leave open,
CERTAIN = 0.1  # and after it, below which the pad looks certain
HIDDEN = "power_law_drag"  # in pads whose cause is asked


def rows_of(cases: Sequence[dict], test: str | None = None) -> list[dict]:
    """Return the tests of all cases, or those of one name."""
    return [row for case in cases for row in case["rows"] if test in (None, row["test"])]


def slope(rows: Sequence[dict], key: str) -> tuple[float, float]:
    """Return the slope of realised (key) over expected bits, through zero, and its sd."""
    x, y = (np.array([row[k] for row in rows]) for k in ("promised", key))
    found = float(x @ y / (x @ x))
    return found, float(np.sqrt(np.sum((y - found * x) ** 2) / (x.size - 1) / (x @ x)))


def halvings(cases: Sequence[dict], test: str, key: str) -> np.ndarray:
    """Return the halvings a minute of the worst constant's sd, by pad; key: sd after the test."""
    rows = rows_of(cases, test)
    return np.array([np.log2(r["sd_now"] / r[key]) / r["minutes"] for r in rows])


def ratios(cases: Sequence[dict], key: str) -> np.ndarray:
    """Return the ratio of each pad's halvings, proposed over standard test; the median counts.

    Infinite where only the standard test did not lower the sd, 0 where neither did.
    """
    proposed, standard = (halvings(cases, name, key) for name in ("proposed", "standard"))
    safe = np.where(standard > 0.0, standard, 1.0)
    return np.where(standard > 0.0, proposed / safe, np.where(proposed > 0.0, np.inf, 0.0))


def judged(cases: Sequence[dict]) -> list[dict]:
    """Return the pads that the diagnosis called ambiguous."""
    return [case for case in cases if "rows" in case]


def verdict(row: dict) -> str:
    """Return how the cause is found after a test, summed over base laws: right, wrong, or open.

    One that the diagnosis did not list is not found.
    """
    if row["after"].get(HIDDEN, 0.0) >= SURE:
        return "right"
    return "wrong" if max(row["after"].values()) >= SURE else "open"


def left_open(cases: Sequence[dict]) -> list[dict]:
    """Return the pads with something unlisted of which the diagnosis says so."""
    return [case for case in cases if case["before"] >= OPEN]


def certain(cases: Sequence[dict]) -> list[dict]:
    """Return the pads left open that look certain after the proposed test."""
    return [case for case in left_open(cases) if case["after"] < CERTAIN]


def goals(constants: Sequence[dict], cause: Sequence[dict], outside: Sequence[dict]) -> list[tuple]:
    """Return what is asked, what was found, and whether that is enough (None without cases)."""
    found: list[tuple] = []
    for key, words in (("realised", "measured anew"), ("held", "held at what was assumed")):
        words = f"realised over expected bits {SLOPE[0]:g} to {SLOPE[1]:g}, noise {words}"
        if not constants:
            found.append((words, "", None))
            continue
        value, error = slope(rows_of(constants), key)
        found.append((words, f"{value:.2f} ± {error:.2f}", SLOPE[0] <= value <= SLOPE[1]))
    words = (
        f"the worst constant's sd falls {RATIO:g} times as fast a minute as by the standard test"
    )
    ratio = float(np.median(ratios(constants, "sd_realised"))) if constants else np.nan
    found.append((words, f"{ratio:.1f}", ratio >= RATIO if constants else None))
    some = judged(cause)
    right = sum(verdict(row) == "right" for row in rows_of(some, "proposed"))
    words = f"{RESOLVED:.0%} of ambiguous pads resolved rightly by one proposed test"
    enough = right >= RESOLVED * len(some) if some else None
    found.append((words, f"{right} of {len(some)}", enough))
    left, sure = left_open(outside), certain(outside)
    words = "with something unlisted left open, no pad looks certain after the proposed test"
    found.append((words, f"{len(sure)} of {len(left)} do", not sure if left else None))
    return found
