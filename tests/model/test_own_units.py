"""The same measurements in other units give the same answer in those units."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.posteriors import build_posterior

from qlvbayes.effects.catalogue import EFFECTS
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.io.units import PAD, STRAIN, unit_system
from qlvbayes.io.wording import plain
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import described_fields, factors
from qlvbayes.model.parameters import draw_priors, is_prior, unconstrained
from qlvbayes.motion.experiment import prepare

LENGTHS = {"mm": 1.0, "um": 1e3, "nm": 1e6, "m": 1e-3}
FORCES = {"N": 1.0, "mN": 1e3, "uN": 1e6, "nN": 1e9}
SYSTEMS = [(x, f) for x in LENGTHS for f in FORCES]


def written(tmp_path, length, force):
    """Two ramps and holds, 1 and 20 mm/s to 1 mm, in a file of these units."""
    rng = np.random.default_rng(3)
    lines = [f"test,time_s,displacement_{length},force_{force}"]
    for rate in (1.0, 20.0):
        time = np.linspace(0.0, 1.0 / rate + 3.0, 600)
        depth = np.clip(rate * (time - 0.1), 0.0, 1.0)
        press = depth * (0.7 + 0.3 * np.exp(-time)) + 1e-3 * rng.standard_normal(time.size)
        rows = zip(time, depth * LENGTHS[length], press * FORCES[force], strict=True)
        lines += [f"r{rate:g},{t:.9g},{d:.15g},{f:.15g}" for t, d, f in rows]
    path = tmp_path / f"{length}_{force}.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(("length", "force"), [("um", "nN"), ("m", "mN")])
def test_motion_roles_and_noise_do_not_depend_on_units(tmp_path, length, force):
    baseline, other = (
        prepare(read_measurements(written(tmp_path, *names)).pads[0])
        for names in (("mm", "N"), (length, force))
    )
    assert other.units == unit_system(length, force)
    assert [trial.role for trial in other.trials] == [trial.role for trial in baseline.trials]
    kinds = [[[p.kind for p in t.phases] for t in found.trials] for found in (baseline, other)]
    assert kinds[0] == kinds[1]
    rates = np.array([[t.rate for t in found.trials] for found in (baseline, other)])
    np.testing.assert_allclose(rates[1], LENGTHS[length] * rates[0], rtol=1e-6)
    for noise in ("white", "ou"):
        ours, theirs = getattr(baseline.floor, noise), getattr(other.floor, noise)
        assert theirs == pytest.approx(FORCES[force] * ours, rel=1e-4)


@settings(deadline=None)  # the first example imports and compiles
@given(st.sampled_from(SYSTEMS), st.sampled_from(SYSTEMS))
def test_converted_constants_give_the_same_force(given_units, wanted_units):
    first, second = unit_system(*given_units), unit_system(*wanted_units)
    choices = Choices(elastic="hertz", effects=("power_law_drag", "inertia", "frame_compliance"))
    names = [name for field in described_fields(choices) for name in field.names]
    draws = {name: np.full(2, 0.7) for name in names}
    by = factors(choices, draws, first, second)
    length, force = (first.factor_to(second, kind) for kind in ("displacement", "force"))
    n = 0.7
    before, after = 0.3**n, (0.3 * length) ** n
    for name in ("m", "power_law_drag.k"):
        np.testing.assert_allclose(by[name] * after, force * before, rtol=1e-9)
    assert by["inertia.mass"] * length == pytest.approx(force, rel=1e-9)
    assert by["frame_compliance.compliance"] * force == pytest.approx(length, rel=1e-9)
    assert by["v[1]"] == by["c[0]"] == 1.0


@pytest.mark.parametrize("law", ["exponential", "linear", "polynomial:3", "toe"])
@pytest.mark.parametrize(("length", "force"), [("um", "nN"), ("m", "mN")])
@pytest.mark.few(1)
def test_posterior_does_not_depend_on_units(tmp_path, law, length, force):
    """Priors and likelihood: the same constants have, but for a factor of all, the same density."""
    # drag by a power of the speed has its prior at the unit's own speed
    kinds = {kind.name for kind in EFFECTS} - {"power_law_drag", "adhesion"}
    choices = Choices(elastic=law, effects=tuple(sorted(kinds)))
    first, second = (
        prepare(read_measurements(written(tmp_path, *names)).pads[0], all_tests=True)
        for names in (("mm", "N"), (length, force))
    )
    ours, theirs = (build_posterior(e, choices, e.trials) for e in (first, second))
    rng = np.random.default_rng(5)
    middle = np.median(draw_priors(ours.model, 50, np.random.default_rng(0)), axis=0)
    steps = 0.1 * ours.parameters.length * rng.standard_normal((4, ours.size))
    thetas, names = ours.parameters.within(middle + steps), ours.names
    constants = ours.parameters.constants(thetas)
    by = factors(choices, dict(zip(names, constants.T, strict=True)), first.units, second.units)
    converted = constants * np.array([by[name] for name in names])
    others = np.concatenate(
        [
            unconstrained(leaf.prior, values if values.shape[1] > 1 else values[:, 0])
            for leaf in theirs.parameters.leaves
            if is_prior(leaf.prior)
            for values in [converted[:, list(leaf.constants)]]
        ],
        axis=1,
    )
    densities = [one.log_density(at) for one, at in ((ours, thetas), (theirs, others))]
    np.testing.assert_allclose(*(x - x[0] for x in densities), rtol=1e-3, atol=0.1)


def test_strain_is_no_length_and_a_summary_says_its_units():
    with pytest.raises(InputError, match="cannot be converted"):
        factors(Choices(), {}, PAD, STRAIN)
    with pytest.raises(KeyError):
        unit_system("1", "nN")
    units = unit_system("um", "nN")
    found = FitSummary(
        pad="a", units=units, effects=(), sampler="emcee", converged=True, parameters={}
    ).as_dict()
    assert found["units"] == {"displacement": "um", "force": "nN"}


@pytest.mark.parametrize(
    ("units", "energy"),
    [(("mm", "N"), "mJ"), (("um", "nN"), "fJ"), (("um", "mN"), "nJ"), (("1", "MPa"), "MJ/m3"),
     (("1", "Pa"), "J/m3")],
)  # fmt: skip
def test_energy_is_force_times_displacement(units, energy):
    assert unit_system(*units).energy == energy


@pytest.mark.parametrize(
    ("value", "text"),
    [(23.16, "23.2"), (2.316e-8, "2.32e-08"), (25123.0, "25100"), (99960.0, "100000"),
     (0.5, "0.5")],
)  # fmt: skip
def test_numbers_are_read_without_a_power_of_ten(value, text):
    assert plain(value) == text
