"""The error of a measured contact is part of the intervals of least squares."""

import numpy as np
import pytest

from qlvbayes.fitting.fit import fit_pad
from qlvbayes.io.data import Pad
from qlvbayes.io.data import Test as Measured
from qlvbayes.io.units import PAD
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare

SD = 0.04  # mm
TIME = np.arange(0.0, 6.0, 0.01)
DEPTH = np.minimum(2.0 * TIME, 1.5)


def force_of_a_sphere():
    """Force of 0.9 d^1.5 with one relaxation time of 0.5 s, and a noise of 2 mN."""
    steps, part = np.diff(0.9 * DEPTH**1.5, prepend=0.0), np.zeros_like(TIME)
    for k in range(1, TIME.size):
        part[k] = np.exp(-0.02) * part[k - 1] + np.exp(-0.01) * steps[k]
    noise = np.random.default_rng(0).normal(0.0, 0.002, TIME.size)
    return 0.6 * np.cumsum(steps) + 0.4 * part + noise


def fitted(off=0.0, **more):
    test = Measured("t", "P", TIME, DEPTH + off * (DEPTH > 0), force_of_a_sphere(), **more)
    choices = Choices(modes=1, elastic="hertz")
    return fit_pad(prepare(Pad("P", (test,), PAD)), choices, method="least-squares").summary()


def test_an_interval_is_as_wide_as_refits_with_another_contact_say():
    exact, further, nearer = fitted(), fitted(SD), fitted(-SD)
    for stage in ("", "12.4"):
        found = fitted(contact_sd=SD, contact_stage=stage)
        for name in ("m", "n"):
            moved = 0.5 * (further[name].mean - nearer[name].mean)
            expected = np.hypot(moved, exact[name].sd)
            assert found[name].sd == pytest.approx(expected, rel=0.2), name
            assert found[name].sd > 5.0 * exact[name].sd
        assert any("contact point is uncertain" in text for text in found.notices)
