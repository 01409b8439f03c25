"""The pad's differential equations against the hereditary integral and its limits."""

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from qlvbayes.io.checks import InputError
from qlvbayes.simulate import (
    PAPER_RATES,
    TABLE_1,
    Hold,
    Move,
    Pad,
    Platen,
    draw_constants,
    paper_protocol,
)

NODES, WEIGHTS = leggauss(20)


def hereditary_integral(constants, platen, t, panels=100):
    """Integral of g(t - s) K(d(s)) d'(s) over s, Gauss-Legendre between the kinks."""
    edges = np.clip(np.append(platen.kinks, platen.duration), 0.0, t)
    ends = np.linspace(edges[:-1], edges[1:], panels + 1)
    half = 0.5 * np.diff(ends, axis=0)[..., None]
    s = ends[:-1, :, None] + half * (1.0 + NODES)
    g = constants.c[0] + sum(
        c * np.exp(-v * (t - s)) for c, v in zip(constants.c[1:], constants.v, strict=True)
    )
    stiffness = constants.m * np.exp(constants.b * platen.displacement(s))
    return np.sum(half * WEIGHTS * g * stiffness * platen.velocity(s))


def times_of_interest(platen):
    around = platen.kinks[:, None] + [-1e-3, 0.0, 1e-3, 0.05]
    times = np.concatenate([around.ravel(), np.linspace(0.0, platen.duration, 20)])
    return np.unique(np.clip(times, 0.0, platen.duration))


RETRACTED = (Move(1.6, 20.0), Hold(2.0), Move(0.0, 5.0), Hold(5.0), Move(1.0, 50.0))


@pytest.mark.parametrize("program", [*map(paper_protocol, PAPER_RATES), RETRACTED])
@pytest.mark.parametrize("constants", [*TABLE_1.values(), draw_constants(np.random.default_rng(1))])
@pytest.mark.few(6)
def test_equations_agree_with_the_hereditary_integral(constants, program):
    platen = Platen(program)
    times = times_of_interest(platen)
    force = Pad(constants, bonded=True).force(platen, times)
    integral = np.array([hereditary_integral(constants, platen, t) for t in times])
    assert np.abs(force - integral).max() < 1e-8 * integral.max()


@pytest.mark.parametrize(
    ("pad", "peak", "relaxed"), [("A", 1.36, 0.308), ("B", 1.59, 0.296), ("C", 2.43, 0.329)]
)
def test_instantaneous_peak_and_relaxed_share_of_table_1(pad, peak, relaxed):
    at_once = Platen((Move(1.6, 1e6), Hold(200.0)), acceleration_limit=1e12)
    force = Pad(TABLE_1[pad]).force(at_once, np.array([at_once.kinks[-1], at_once.duration]))
    assert force[0] == pytest.approx(peak, abs=0.005)
    assert force[1] / force[0] == pytest.approx(relaxed, abs=5e-4)
    assert force[0] == pytest.approx(TABLE_1[pad].force(1.6), rel=2e-5)


def test_a_free_pad_lets_go_and_faster_loading_gives_a_higher_peak():
    platen = Platen((Move(1.6, 20.0), Hold(5.0), Move(0.0, 20.0), Hold(5.0)))
    times = np.arange(0.0, platen.duration, 1e-3)
    bonded = Pad(TABLE_1["B"], bonded=True).force(platen, times)
    free = Pad(TABLE_1["B"]).force(platen, times)
    assert bonded.min() < -0.1
    assert np.array_equal(free, np.maximum(bonded, 0.0))
    peaks = []
    for rate in (*PAPER_RATES, 1000.0):
        platen = Platen(paper_protocol(rate))
        peaks.append(Pad(TABLE_1["B"]).force(platen, platen.kinks).max())
    assert np.all(np.diff(peaks[:-1]) > 0)
    assert peaks[-1] == peaks[-2]
    platen = Platen(paper_protocol(20.0))
    for times in ([0.0, 1e3], [-1.0, 0.0], [1.0, 0.5]):
        with pytest.raises(InputError):
            Pad(TABLE_1["A"]).force(platen, np.array(times))
