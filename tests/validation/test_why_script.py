"""Why verdicts were wrong: causes on numbers, readings, the truth in the package's words."""

from dataclasses import fields, replace

import jax.numpy as jnp
import numpy as np
import pytest
from causes import CAUSES, RIGHT, Compared, carrying_half, one_by_one
from page import Origin
from registration import Registration
from support.simulated import CLOSE, START, grid_of, motion_of
from truth import Rig, is_modelled, truths
from why_page import why_page

from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.effects.catalogue import EFFECTS, EVERY, find
from qlvbayes.evaluation.study import make_study
from qlvbayes.laws.catalogue import find_elastic, find_relaxation
from qlvbayes.model.model import Model
from qlvbayes.motion.experiment import prepare
from qlvbayes.simulate import (
    FOREIGN,
    FORMS,
    FURTHER,
    HIDDEN,
    OUTSIDE,
    HiddenPad,
    Platen,
    paper_protocol,
)
from qlvbayes.simulate.hidden import effect_class
from qlvbayes.simulate.laws import ELASTIC, RELAXATION, Law

# the cause, from numbers

FOUND = Compared(-100.0, -100.0, -100.0, True, False, False, False)


@pytest.mark.parametrize(
    ("given", "cause"),
    [
        ({"truth": None}, "left out"),
        ({"seen": -np.inf}, "search"),  # never seen, and as likely as the answer
        ({"seen": -np.inf, "truth": -102.9}, "search"),
        ({"seen": -np.inf, "truth": -103.1}, "imitation"),  # finding it would not have helped
        ({"seen": -np.inf, "truth": -103.1, "sound": False}, "error budget"),
        ({"seen": -104.0}, "search"),  # at a mode 4 nats lower
        ({"seen": -102.0}, "undecided"),
        ({"truth": -60.0, "seen": -64.0, "same": True}, "search"),
        ({"truth": -90.0, "seen": -90.0}, "verdict"),  # seen, likelier, refused
        ({"truth": -90.0, "seen": -90.0, "sound": False}, "error budget"),
        ({"same": True}, "verdict"),
        ({"same": True, "sound": False}, "error budget"),
        ({"same": True, "sound": False, "outsider": True}, "verdict"),
        ({"truth": -103.1, "seen": -103.1}, "imitation"),
        ({"truth": -800.0, "seen": -800.0, "sound": False}, "error budget"),
        ({"outsider": True, "misled": True}, "imitation"),
        ({"outsider": True, "misled": True, "seen": -np.inf}, "search"),
        ({"outsider": True, "truth": -800.0, "seen": -800.0, "sound": False}, "error budget"),
        ({"misled": True}, "undecided"),  # without an outsider a wrong name is no cause
    ],
)  # fmt: skip
def test_the_cause_follows_from_three_log_posteriors(given, cause):
    assert replace(FOUND, **given).cause == cause


# the readings that carry a difference


def test_half_of_a_difference_may_lie_in_one_reading():
    assert carrying_half(np.array([1.0, -2.0, 6.0, 1.0, 3.0])) == [2]
    assert carrying_half(np.array([1.0, 2.0, 1.0, 2.0])) == [1, 3]
    assert carrying_half(np.ones(10)) == [0, 1, 2, 3, 4]
    assert carrying_half(np.array([1.0, -2.0])) == []


def test_readings_one_by_one_are_the_joint_density():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((6, 6))
    covariance, residual = root @ root.T + np.eye(6), rng.standard_normal(6)
    free, scale = one_by_one(np.linalg.inv(covariance), residual)
    joint = -0.5 * (residual @ np.linalg.solve(covariance, residual))
    joint -= 0.5 * np.linalg.slogdet(covariance)[1]
    assert np.sum(scale - 0.5 * free**2) == pytest.approx(joint, abs=1e-10)
    # the first is given nothing, the last all others
    assert free[0] == pytest.approx(residual[0] / np.sqrt(covariance[0, 0]))
    assert scale[-1] == pytest.approx(0.5 * np.log(np.linalg.inv(covariance)[-1, -1]))


# the truth in the package's words

LAWS = {
    "exponential": (0.5, 0.8), "hertz": (0.6,), "polynomial": (0.4, 0.2, 0.15),
    "toe": (0.4, 1.1, 0.4), "prony:2": (0.4, 6.0, 0.2, 0.2),
    "prony:3": (0.3, 8.0, 0.2, 1.0, 0.15, 0.1), "power-law": (0.2, 0.05, 0.3),
    "fung": (0.3, 0.02, 60.0), "stretched": (0.2, 0.5, 0.5),
}  # fmt: skip
RIG = Rig(gap=0.01, depth=1.6, peak=1.0, duration=600.0)


def law(elastic="exponential", relaxation="prony:2"):
    return Law(elastic, LAWS[elastic], relaxation, LAWS[relaxation])


def model_of(truth):
    """The package's model at the true constants."""
    own = truth.hypothesis

    known = truth.constants | {
        "power_law_drainage.stroke": RIG.depth, "pressure_friction.pressed": RIG.peak,
    }  # fmt: skip

    def filled(kind, prefix=""):
        """With the constants of a field by its own name, or by that of its first number."""
        names = {n: (f"{prefix}{n}", f"{n}[0]", f"{n}[1]") for n in kind.units}
        first = {n: next(key for key in keys if key in known) for n, keys in names.items()}
        return kind(**{n: jnp.asarray(known[key]) for n, key in first.items()})

    relaxation = find_relaxation(own.relaxation.partition(":")[0])
    model = Model(filled(find_elastic(own.elastic)), filled(relaxation))
    for name in own.effects:
        model = model + filled(find(name, EVERY), f"{name}.")
    return model


def disagreement(truth, pad, speed=20.0):
    platen = Platen(paper_protocol(speed), start_s=START, number=2)
    time = grid_of(platen)
    found = np.asarray(model_of(truth).force(motion_of(platen, time)))[: time.size]
    true = pad.force(platen, time)
    return np.max(np.abs(found - true)) / np.max(np.abs(true))


@pytest.mark.parametrize(
    ("elastic", "relaxation"),
    [*((one, "prony:2") for one in ELASTIC), *(("exponential", one) for one in RELAXATION)],
)
def test_the_laws_force_is_the_simulators(elastic, relaxation):
    hidden = law(elastic, relaxation)
    truth = truths(hidden, (), RIG)[0]
    assert truth.exact
    # the simulator carries other relaxations by modes, within 1e-3 of g(0)
    near = CLOSE if relaxation.startswith("prony") else 1e-3
    assert disagreement(truth, HiddenPad(hidden)) < near


SOME = {
    "friction": {"strength": 0.05, "reach": 0.05},
    "contact_offset": {"gap": 0.04},
    "extra_relaxation_mode": {"c": 0.2, "v": 1.5},
    "fluid_pressure": {"k": 0.1, "tau": 1.0, "a": 0.2},
    "saturating_leak": {"share": 0.2, "time": 300.0},
    "saturating_drift": {"offset": 0.05, "time": 200.0},
    "coulomb_friction": {"mu": 0.05, "reach": 0.05},
    "bending_frame": {"compliance": 0.05, "force": 1.0},
    "channel_low_pass": {"time": 0.01},
    "quadratic_pressure": {"k": 0.1, "drain": 20.0},
    "guide_friction": {"strength": 0.05, "reach": 0.02, "sharp": 0.8},
    "guide_drag": {"eta": 0.003},
}


@pytest.mark.parametrize("name", SOME)
def test_an_effects_force_is_the_simulators(name):
    effect = effect_class(name)(**SOME[name])
    truth = truths(law(), [effect], replace(RIG, gap=0.0))[0]
    assert truth.exact
    assert disagreement(truth, HiddenPad(law(), (effect,))) < CLOSE


def test_a_mode_hidden_beside_three_is_exact_only_beside_two():
    extra = effect_class("extra_relaxation_mode")(c=0.2, v=2.0)
    assert truths(law(), [extra], RIG)[0].exact
    four = truths(law(relaxation="prony:3"), [extra], RIG)[0]
    assert not four.exact
    shares = [*four.constants["c[0]"], four.constants["extra_relaxation_mode.c"]]
    assert sum(shares[:3]) == pytest.approx(1.0)
    assert min(shares) > 0.0


def drawn(name):
    """An effect with constants of no account."""
    kind = effect_class(name)
    return kind(**{field.name: 0.5 for field in fields(kind)})


def test_every_form_has_its_nearest_and_an_outsider_none():
    listed = {kind.name for kind in EFFECTS}
    for name in (*HIDDEN, *FORMS, *FOREIGN):
        assert is_modelled([name])
        (effects,) = {one.hypothesis.effects for one in truths(law(), [drawn(name)], RIG)[:1]}
        (family,) = {find(own, EVERY).family() for own in effects}
        assert family in listed
        assert family in (effect_class(name).family or name).split("/")
    seeded = {"slip", "rezeroed", "cracking_skin", "rolling_specimen"}
    for name in set({**OUTSIDE, **FURTHER}) - seeded:
        assert truths(law(), [drawn(name)], RIG)[0].hypothesis.effects == frozenset()
        assert not is_modelled(["friction", name])


def test_the_rigs_gap_is_true_beside_all_but_another_contact():
    plain, gap = truths(law(), [drawn("friction")], RIG)
    assert gap.hypothesis == plain.hypothesis.plus("contact_offset")
    assert gap.constants["contact_offset.gap"] == RIG.gap
    (contact,) = truths(law(), [effect_class("contact_offset")(gap=0.04)], RIG)
    assert contact.constants["contact_offset.gap"] == pytest.approx(0.05)


def test_true_constants_come_back_from_the_free_numbers():
    """For a study with a hidden form theta stands for what was hidden, within bounds."""
    study = make_study(Registration.read("bounds").population, 283)
    experiment = prepare(study.pad)
    density = build_search(experiment).density
    scales = experiment.scales
    rig = Rig(study.rig.gap, scales.depth, scales.force, scales.clock)
    for truth in truths(study.law, [effect_class("friction")(strength=0.05, reach=0.02)], rig):
        own = density.space.parameters(truth.hypothesis)
        constants = dict(zip(own.names, own.constants(truth.theta(own)[None])[0], strict=True))
        for name, value in truth.constants.items():
            first = float(np.ravel(value)[0])
            assert constants[name] == pytest.approx(first, rel=1e-6), name


# the page

ORIGIN = Origin("command", "today", "commit", "machine")


def case(index, cause, **more):
    figures = {"chi2": 1.0}
    found = {
        "index": index, "kind": "single", "names": ["friction"], "cause": cause,
        "verdict": "adequate", "answer": "hertz, fung", "log_answer": -10.0,
        "log_truth": -30.0, "log_seen": None,
        "exact": True, "fit": figures, "said": figures, "true_constants": None,
        "readings": {"nats": 0.0, "half": 0, "of": 9, "largest": []},
    }  # fmt: skip
    return found | more


def test_the_page_counts_before_and_now_over_the_same_studies():
    before = {
        "commit": "old",
        "cases": [case(1, "search"), case(2, "error budget"), case(3, "search")],
    }
    found = [case(1, RIGHT), case(2, "error budget")]
    page = why_page("run", found, 9, ORIGIN, before)
    assert "| right now | 1 |" in page
    assert "Of the 2 studies that an earlier commit explained too:" in page
    assert "| right now | 0 | 1 |" in page
    assert "| search | 1 | 0 |" in page
    assert "| error budget | 1 | 1 |" in page
    assert "| 1 | friction | adequate | hertz, fung | right | -20.0 | - |" in page


def test_every_cause_is_explained_on_the_page():
    page = why_page("run", [case(k, cause) for k, cause in enumerate(CAUSES)], 9, ORIGIN, None)
    for cause in set(CAUSES) - {"failed"}:
        assert f"`{cause}`" in page
        assert f"| {cause} | 1 |" in page
