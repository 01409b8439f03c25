"""A model laid over a pad's tests by hand: its force, its fits, what effects would look like."""

import numpy as np
import pytest
from support.endtoend import two_tests

import qlvbayes as q
from qlvbayes.fitting.prediction import predict
from qlvbayes.io.checks import InputError


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    study = q.read_study(two_tests(tmp_path_factory.mktemp("bench") / "two.csv"))
    return q.Bench.from_experiment(study["C"].experiment)


@pytest.fixture(scope="module")
def first(bench):
    return bench.first()


@pytest.fixture(scope="module")
def dragged(bench, first):
    return bench.add(first, "squeeze_film")


def test_the_force_is_that_of_predict(bench, dragged):
    """On its own grid, whose straight lines may make a tenth of the noise."""
    choices = q.Choices(noise="white", effects=("squeeze_film",))
    constants = {name: np.array([value]) for name, value in dragged.values.items()}
    constants["noise.white"] = np.array([bench.noise])
    trials = bench.experiment.trials
    forces = bench.look(dragged).forces
    for k, found in enumerate(predict(bench.experiment, choices, constants, trials)):
        time = bench.samples.trials[k].test.time[bench.samples.rows[k]]
        places = np.searchsorted(found.time, time)
        np.testing.assert_array_equal(found.time[places], time)
        assert np.abs(forces[k] - found.mean[places]).max() < 0.1 * bench.noise


def test_what_is_hidden_takes_the_error_to_the_noise(bench, first, dragged):
    """The error is that of the samples, and what is added can be taken out again."""
    look = bench.look(first)
    left = [y - f for y, f in zip(bench.samples.observed, look.forces, strict=True)]
    assert look.error == pytest.approx(np.sqrt(np.mean(np.concatenate(left) ** 2)))
    squares = sum(cell.n * cell.rmse**2 for cell in look.cells)
    assert squares == pytest.approx(look.error**2 * sum(cell.n for cell in look.cells))
    before, after = bench.look(first).error, bench.look(dragged).error
    assert after < 1.2 * bench.noise < before
    without = bench.remove(dragged, "squeeze_film")
    assert bench.look(without).error == pytest.approx(before, rel=0.02)
    assert not any(name.startswith("squeeze_film") for name in without.values)
    *steps, before = bench.held_out(first)
    assert steps == [None, None]
    *_, after = bench.held_out(dragged)
    assert after < before


def test_no_near_constants_fit_better(bench, dragged):
    """The fit is the least of its sum of squares along every constant."""

    def cost(values):
        model = q.ByHand(dragged.elastic, dragged.relaxation, dragged.effects, values)
        return bench.density.terms(bench._point(model), 0.0).loss

    least = cost(dragged.values)
    for name in ("m", "b", "v[1]", "squeeze_film.eta"):
        for factor in (0.98, 1.02):
            moved = {**dragged.values, name: factor * dragged.values[name]}
            assert cost(moved) > least


def test_a_signature_is_the_effects_force_and_the_right_one_takes_most(bench, first):
    """Adding the effect brings what the signature shows, as a drag is linear in its size."""
    found = bench.signature(first, "viscous_drag")
    assert found.amplitude == "viscous_drag.eta"
    assert found.unit == "N s/mm"
    values = {**first.values, "viscous_drag.eta": found.size}
    with_it = bench.look(q.ByHand(first.elastic, first.relaxation, ("viscous_drag",), values))
    plain = bench.look(first)
    for alone, two, one in zip(found.alone, with_it.forces, plain.forces, strict=True):
        np.testing.assert_allclose(alone, two - one, atol=1e-9)
    added = bench.look(bench.add(first, "viscous_drag"))
    assert added.error == pytest.approx(found.error, rel=0.1)
    assert found.takes == pytest.approx(1.0 - (found.error / plain.error) ** 2)
    names = ("squeeze_film", "force_offset", "stress_softening", "fluid_leak")
    takes = {name: bench.signature(first, name).takes for name in names}
    assert max(takes, key=takes.get) == "squeeze_film"
    assert all(-0.05 < share < 1.0 for share in takes.values())


def test_another_law_begins_near_the_first_and_sliders_may_stand_anywhere(bench, first):
    """A polynomial of the third order follows the exponential closely at these depths."""
    other = bench.rebase(first, elastic="polynomial:3")
    assert other.elastic == "polynomial:3"
    assert bench.look(other).error < 1.2 * bench.look(first).error
    values = {"c[1]": 0.9, "c[2]": 0.6, "v[1]": 0.1, "v[2]": 5.0}
    found = bench.look(q.ByHand(values=values)).values
    assert found["c[0]"] + found["c[1]"] + found["c[2]"] == pytest.approx(1.0)
    assert found["c[0]"] >= 0.0
    assert (found["v[1]"], found["v[2]"]) == (5.0, 0.1)


@pytest.mark.parametrize(
    ("model", "word"),
    [(q.ByHand(elastic="steel"), "steel"), (q.ByHand(relaxation="never"), "never"),
     (q.ByHand(effects=("magic",)), "magic"), (q.ByHand(values={"m": float("nan")}), "m "),
     (q.ByHand(effects=("friction", "pressure_friction")), "pressure_friction")],
)  # fmt: skip
def test_what_is_no_model_is_refused(bench, dragged, model, word):
    with pytest.raises(InputError, match=word):
        bench.look(model)
    with pytest.raises(InputError, match="squeeze_film"):
        bench.add(dragged, "squeeze_film")
    with pytest.raises(InputError, match="friction"):
        bench.remove(dragged, "friction")


def test_a_band_holds_as_many_readings_as_it_says(bench, dragged):
    """Of draws that are all the fitted constants: the force is the model's, and the rest noise."""
    draws = np.tile(list(dragged.values.values()), (500, 1))
    bands = bench.bands(dragged, list(dragged.values), draws)
    observed, forces = bench.samples.observed, bench.look(dragged).forces
    inside = []
    for (low, mean, high), read, force in zip(bands, observed, forces, strict=True):
        np.testing.assert_allclose(mean, force, atol=1e-9)
        inside.append((low < read) & (read < high))
    assert np.mean(np.concatenate(inside)) == pytest.approx(0.9, abs=0.05)
    off = np.tile([1.5 * x for x in dragged.values.values()], (500, 1))
    assert (bench.bands(dragged, list(dragged.values), off)[0][1] > bands[0][1]).mean() > 0.5


def test_noise_alone_hardly_exceeds_a_cells_limit(bench):
    """Realisations of the floor, by its definition: white, and correlated over its time."""
    floor, samples, rng = bench.experiment.floor, bench.samples, np.random.default_rng(4)
    beyond = np.zeros(1000, dtype=bool)
    for k, trial in enumerate(samples.trials):
        time = trial.test.time[samples.rows[k]]
        apart = np.abs(time[:, None] - time)
        root = np.linalg.cholesky(np.exp(-apart / floor.tau) + 1e-9 * np.eye(time.size))
        noise = floor.ou * root @ rng.standard_normal((time.size, beyond.size))
        noise += floor.white * rng.standard_normal(noise.shape)
        for kind in set(samples.phases(k)):
            error = np.sqrt(np.mean(noise[samples.phases(k) == kind] ** 2, axis=0))
            beyond |= error > bench.limits[trial.name, kind]
    assert 0.002 < beyond.mean() < 0.025  # 1 %, but for chance and the approximation


def test_cells_fail_where_the_model_is_wrong_and_not_where_it_is_right(bench, dragged):
    def failing(model):
        cells = bench.look(model).cells
        return {c.phase for c in cells if c.rmse > bench.limits[c.test, c.phase]}

    assert not failing(dragged)
    stiff = {**dragged.values, "m": 1.2 * dragged.values["m"]}
    stiffer = q.ByHand(dragged.elastic, dragged.relaxation, dragged.effects, stiff)
    assert failing(stiffer) == {"ramp", "hold", "unload", "recovery"}
