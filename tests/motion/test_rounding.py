"""Phases and relative noise depend on no unit of force, no load and no digits."""

from dataclasses import replace

import numpy as np
import pytest
from support.solids import made_ready

from qlvbayes.io.data import Control, Test


def creep(wiggle):
    """A Kelvin solid under a force that is constant but for rounding, at growing times."""
    time = np.concatenate([np.arange(0.0, 0.02, 0.001), np.geomspace(0.02, 60.0, 250)])
    displacement = 0.2 * -np.expm1(-time / 0.02) + 0.05 * -np.expm1(-time / 8.0)
    rounding = wiggle * np.random.default_rng(0).uniform(-1.0, 1.0, time.size)
    return Test("t", "p", time, displacement, 1.0 + np.where(time < 0.01, 0.0, rounding))


def pressed(white):
    time = np.arange(0.0, 20.0, 0.02)
    displacement = np.interp(time, [0.0, 1.0, 20.0], [0.0, 1.0, 1.0])
    noise = white * np.random.default_rng(0).standard_normal(time.size)
    force = 0.5 * np.minimum(time, 1.0) * (0.6 + 0.4 * np.exp(-np.maximum(time - 1.0, 0.0)))
    return Test("t", "p", time, displacement, force + noise)


def seen(test, factor, digits=None):
    force = factor * test.force
    if digits is not None:
        force = np.array([float(f"{value:.{digits}g}") for value in force])
    experiment = made_ready(replace(test, force=force))
    (trial,) = experiment.trials
    floor = experiment.floor
    relative = [floor.white / experiment.peak, floor.ou / experiment.peak, floor.tau]
    phases = [(p.kind, p.control, round(p.start, 9), round(p.stop, 9)) for p in trial.phases]
    return phases, relative, len(experiment.notices) + len(floor.notices)


@pytest.mark.parametrize("test", [creep(0.0), creep(3e-9), creep(1e-6), pressed(2e-3)])
@pytest.mark.parametrize("factor", [0.37, 5e-4, 1e3 / 7.0, 1e-9, 6.02e8])
@pytest.mark.few(6)
def test_another_unit_of_force_changes_nothing_else(test, factor):
    phases, relative, notices = seen(test, 1.0)
    of_other = seen(test, factor)
    assert of_other[0] == phases
    assert of_other[1] == pytest.approx(relative, rel=1e-4)
    assert of_other[2] == notices


@pytest.mark.parametrize("digits", [6, 9, 12])
def test_digits_of_a_held_force_change_nothing_else(digits):
    phases, relative, notices = seen(creep(3e-9), 0.37)
    of_fewer = seen(creep(3e-9), 0.37, digits)
    assert of_fewer[0] == phases
    assert of_fewer[1] == pytest.approx(relative, rel=1e-3)
    assert of_fewer[2] == notices
    # a weight put on is creep under a force
    assert [phase[:2] for phase in phases] == [("hold", Control.FORCE)]
    assert relative[0] < 1e-3
