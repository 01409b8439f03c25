"""Find rows at the beginning of a record that a logger wrote before it read its channels."""

from __future__ import annotations

import numpy as np

from qlvbayes.io.arrays import Array as Floats

UNREAD = "rows before the channels were read, both exactly 0"
_JUMP = 5.0  # times the record's largest step and speed, beyond which it does not move so
_GRADUAL = 3.0  # times its largest step, which the rest must span to be a motion in steps
_ANSWER = 0.1  # share of the record's own stiffness, below which the force ignores the jump
_LEAST = 10  # rows that the rest must have


def unread_rows(time: Floats, way: Floats, load: Floats) -> int:
    """Return how many rows at the beginning hold no reading: both channels are exactly zero."""
    zero = (way == 0.0) & (load == 0.0)
    if not zero[0] or zero.all():
        return 0
    first = int(np.argmin(zero))
    moved, loaded = way[first:], load[first:]
    if len(moved) < _LEAST:
        return 0
    steps, spent = np.abs(np.diff(moved)), np.diff(time[first:])
    passed = float(time[first] - time[first - 1])
    jump, span = abs(float(moved[0])), float(np.ptp(moved))
    if passed <= 0.0 or not (spent > 0.0).any() or span <= _GRADUAL * float(steps.max()):
        return 0
    speed = float((steps[spent > 0.0] / spent[spent > 0.0]).max())
    if jump <= _JUMP * float(steps.max()) or jump / passed <= _JUMP * speed:
        return 0
    stiffness = float(np.ptp(loaded)) / span
    return first if abs(float(loaded[0])) < _ANSWER * stiffness * jump else 0
