"""Check the quantities that an engineer reads from a model by closed forms and quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from qlvbayes.comparison.readings import ReadingSettings, choose, read, readings
from qlvbayes.io.units import PAD, STRAIN
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import described_model, drawn_models, pad_alone
from qlvbayes.model.parameters import fields_of
from qlvbayes.motion.facts import Covered
from qlvbayes.simulate import TABLE_1, Constants

REACH = Covered(depth=1.6, slowest=0.1, fastest=30.0, quickest=0.06, hold=30.0, tests=6)
DEPTH, RATES, FREQUENCIES, HOLD = 1.5, (0.1, 1.0, 30.0), (0.05, 0.3, 1.0, 5.0), 31.0
SETTINGS = ReadingSettings(DEPTH, RATES, FREQUENCIES, HOLD, REACH)
PADS = {
    **TABLE_1,
    "quick": Constants(1.0, 0.8, (0.1, 0.5, 0.4), (40.0, 2.0)),
    "linear": Constants(0.5, 1e-9, (0.5, 0.3, 0.2), (1.0, 0.05)),
}


def constants(pad):
    found = {"m": pad.m, "b": pad.b}
    found |= {f"c[{k}]": c for k, c in enumerate(pad.c)}
    return found | {f"v[{k}]": v for k, v in enumerate(pad.v, start=1)}


def measure(choices, sets, settings=SETTINGS):
    """{quantity: (n,)} of some sets of constants."""
    alone = pad_alone(described_model(choices))
    names = list(sets[0])
    models = drawn_models(alone, names, np.array([[s[name] for name in names] for s in sets]))
    table = read(models, settings)
    found = readings(settings, PAD)
    assert table.shape == (len(sets), len(found))
    return {reading.quantity: table[:, k] for k, reading in enumerate(found)}


@pytest.fixture(scope="module")
def plain():
    return measure(Choices(), [constants(pad) for pad in PADS.values()])


def each(function):
    return np.array([function(pad) for pad in PADS.values()])


def relaxation(pad, t):
    return pad.c[0] + sum(c * np.exp(-v * t) for c, v in zip(pad.c[1:], pad.v, strict=True))


def elastic(pad, depth):
    return pad.m / pad.b * np.expm1(pad.b * depth)


def stiffness(pad, depth):
    return pad.m * np.exp(pad.b * depth)


def ramp_force(pad, t, rate):
    """Eq. 6 over an ideal ramp, by adaptive quadrature."""
    integrand = lambda s: relaxation(pad, t - s) * stiffness(pad, rate * s) * rate  # noqa: E731
    points = [t - x / v for v in pad.v for x in (1.0, 10.0) if x / v < t]
    return quad(integrand, 0.0, t, points=points or None, limit=400, epsrel=1e-11)[0]


def test_stiffness_and_force_are_those_of_the_law_and_what_the_hold_leaves(plain):
    np.testing.assert_allclose(
        plain["instantaneous stiffness at 1.5 mm"], each(lambda p: stiffness(p, DEPTH)), rtol=1e-4
    )
    left = each(lambda p: relaxation(p, HOLD))
    np.testing.assert_allclose(
        plain["relaxed stiffness at 1.5 mm"], left * each(lambda p: stiffness(p, DEPTH)), rtol=1e-5
    )
    np.testing.assert_allclose(
        plain["relaxed force at 1.5 mm"], left * each(lambda p: elastic(p, DEPTH)), rtol=1e-5
    )


@pytest.mark.parametrize("rate", RATES)
def test_peak_force_is_the_hereditary_integral_at_the_end_of_the_ramp(plain, rate):
    dense = each(lambda p: ramp_force(p, DEPTH / rate, rate))
    np.testing.assert_allclose(plain[f"peak force at {rate:g} mm/s"], dense, rtol=1e-6)


def test_half_of_the_relaxing_force_is_gone_at_the_half_time(plain):
    def half_time(pad):
        """Each mode has its own state at the end of the fastest ramp and decays from it."""
        rate, end = RATES[-1], DEPTH / RATES[-1]
        states = [
            quad(lambda s, v=v: np.exp(v * (s - end)) * stiffness(pad, rate * s) * rate, 0, end)[0]
            for v in pad.v
        ]

        def force(t):
            modes = zip(pad.c[1:], pad.v, states, strict=True)
            return sum(c * q * np.exp(-v * t) for c, v, q in modes)

        half = 0.5 * (force(0.0) + force(HOLD))
        return brentq(lambda t: force(t) - half, 0.0, HOLD)

    np.testing.assert_allclose(plain["half-relaxation time at 1.5 mm"], each(half_time), rtol=2e-3)


@pytest.mark.parametrize("rate", RATES)
def test_lost_energy_is_the_area_of_the_loop(plain, rate):
    def loop(pad):
        """Loading and unloading, the force never negative, in closed form on a dense grid."""
        end = DEPTH / rate
        t = np.linspace(0.0, 2.0 * end, 40_001)
        depth = np.where(t < end, rate * t, 2.0 * DEPTH - rate * t)
        return float(np.trapezoid(np.maximum(modes_force(pad, t, depth), 0.0), depth))

    np.testing.assert_allclose(
        plain[f"energy lost in a cycle at {rate:g} mm/s"], each(loop), rtol=1e-3
    )


def modes_force(pad, t, depth):
    """Force on a fine grid: every mode by the trapezoidal rule of its own equation."""
    step = np.diff(t)
    force = pad.c[0] * elastic(pad, depth)
    for c, v in zip(pad.c[1:], pad.v, strict=True):
        rises = np.diff(elastic(pad, depth)) * np.exp(-0.5 * v * step)
        state, states = 0.0, [0.0]
        for rise, decay in zip(rises, np.exp(-v * step), strict=True):
            state = state * decay + rise
            states.append(state)
        force = force + c * np.array(states)
    return force


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_loss_tangent_is_that_of_the_prony_series(plain, frequency):
    """G* = c_0 + sum c_i i w/(i w + v_i), whatever the stiffness at the depth."""

    def closed(pad):
        w = 2.0 * np.pi * frequency
        modulus = pad.c[0]
        modulus += sum(c * 1j * w / (1j * w + v) for c, v in zip(pad.c[1:], pad.v, strict=True))
        return modulus.imag / modulus.real

    found = plain[f"loss tangent at {frequency:g} Hz about 1.5 mm"]
    # the oscillation is straight pieces, an error of about (pi / pieces)^2
    np.testing.assert_allclose(found, each(closed), rtol=1.5e-3)


def test_drag_adds_its_own_peak_loss_and_nothing_to_stiffness():
    eta = 0.02
    bare = constants(PADS["B"])
    (without,) = [measure(Choices(), [bare])]
    with_drag = measure(Choices(effects=("viscous_drag",)), [bare | {"viscous_drag.eta": eta}])
    for rate in RATES:
        peak = f"peak force at {rate:g} mm/s"
        assert with_drag[peak] - without[peak] == pytest.approx(eta * rate, rel=1e-6)
    for name in ("instantaneous stiffness", "relaxed stiffness", "relaxed force"):
        name = f"{name} at 1.5 mm"
        assert with_drag[name] == pytest.approx(without[name], rel=1e-9)
    # both ways at 0.1 mm/s, where the pad stays in touch for nearly all of the way
    slow = "energy lost in a cycle at 0.1 mm/s"
    assert with_drag[slow] - without[slow] == pytest.approx(2 * eta * 0.1 * DEPTH, rel=0.15)
    # the loss modulus gains eta w, the storage modulus nothing
    pad, frequency = PADS["B"], 1.0
    w = 2.0 * np.pi * frequency
    modulus = pad.c[0]
    modulus += sum(c * 1j * w / (1j * w + v) for c, v in zip(pad.c[1:], pad.v, strict=True))
    modulus = modulus * stiffness(pad, DEPTH) + 1j * eta * w
    found = with_drag["loss tangent at 1 Hz about 1.5 mm"]
    assert found == pytest.approx(modulus.imag / modulus.real, rel=1.5e-3)


def test_the_rig_is_not_read_as_the_pad():
    """A soft frame or a late channel changes nothing of what the pad is."""
    bare = constants(PADS["B"])
    rig = Choices(effects=("force_drift", "channel_lag", "frame_compliance"))
    fields = [name for field in fields_of(described_model(rig)) for name in field.names]
    extra = {name: 0.5 for name in fields if "." in name}
    np.testing.assert_array_equal(
        list(measure(rig, [bare | extra]).values()), list(measure(Choices(), [bare]).values())
    )


def test_settings_lie_inside_what_both_pads_cover():
    other = Covered(depth=2.2, slowest=0.2, fastest=60.0, quickest=0.03, hold=12.0, tests=3)
    found = choose([REACH, other])
    assert found.depth == 1.5
    assert found.rates == (0.3, 3.0, 30.0)
    assert all(1 / 12 <= f <= 0.25 / 0.06 for f in found.frequencies)
    assert found.hold == 12.0
    assert not any(reading.extrapolated for reading in readings(found, PAD))


@pytest.mark.parametrize(
    ("asked", "far"),
    [
        ({"depth": 2.0}, {r.quantity for r in readings(choose([REACH], depth=2.0), PAD)}),
        (
            {"rates": [1.0, 90.0]},
            {
                "peak force at 90 mm/s",
                "energy lost in a cycle at 90 mm/s",
                "force after 30 s of a hold at 1.5 mm",  # after the fastest ramp
                "share lost in 30 s of a hold at 1.5 mm",
            },
        ),
        ({"frequencies": [0.001, 1.0]}, {"loss tangent at 0.001 Hz about 1.5 mm"}),
    ],
)
def test_what_is_beyond_the_tests_is_called_an_extrapolation(asked, far):
    found = readings(choose([REACH], **asked), PAD)
    assert {reading.quantity for reading in found if reading.extrapolated} == far


@pytest.mark.parametrize(
    ("hold", "fastest", "both"), [(30.0, 30.0, False), (35.0, 30.0, True), (30.0, 0.1, True)]
)
def test_a_force_that_is_another_by_another_name_is_told_once(hold, fastest, both):
    """After a step and 30 s, and after the quickest ramp and 30 s, which is a step beside them."""
    held = ReadingSettings(DEPTH, (0.1, fastest), (1.0,), hold, REACH)
    names = [reading.quantity for reading in readings(held, PAD)]
    assert "force after 30 s of a hold at 1.5 mm" in names
    assert ("relaxed force at 1.5 mm" in names) == both


def test_strain_and_stress_have_their_own_units():
    found = {r.quantity: r.unit for r in readings(SETTINGS, STRAIN)}
    assert found["relaxed stress at strain 1.5"] == "kPa"
    assert found["energy lost in a cycle at 1/s"] == "kJ/m3"
    assert found["instantaneous stiffness at strain 1.5"] == "kPa"
