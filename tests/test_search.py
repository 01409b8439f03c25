"""When an effect is added, and which stand beside it, on rounds and errors made by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from qlvbayes.diagnosis.contest import Contender, Round
from qlvbayes.diagnosis.heldout import HeldOut
from qlvbayes.diagnosis.search import Path, _confirmed, _with_another, confirms
from qlvbayes.diagnosis.settings import Settings
from qlvbayes.diagnosis.swap import _held, _without_weakest, rivals


def contenders(gains: dict[str, float]) -> Round:
    found = tuple(Contender(name, gain, None, SimpleNamespace()) for name, gain in gains.items())
    return Round(None, found)


def step(score, weighed, effects=()):
    return SimpleNamespace(heldout=HeldOut(1.0, weighed, score, ()), effects=effects)


@pytest.mark.parametrize(
    ("score", "weighed", "accepted"),
    [
        (5.0, 0.9, True),
        (5.0, 1.0002, True),
        (5.0, 1.01, False),
        (5.0, 1.1, False),
        (-5.0, 0.9, False),
        (-5.0, 1.1, False),
        (300.0, 1.1, True),
    ],
)
def test_left_out_tests_must_be_likelier_and_no_farther(score, weighed, accepted):
    """A noise model that swells makes far tests a little likelier; it brings none nearer."""
    assert confirms(step(score, weighed), step(0.0, 1.0)) == accepted


def test_the_probability_that_something_lacks_is_that_of_all_effects():
    settings = Settings()
    found = contenders({"a": 3.2, "b": 1.0, "c": -2.0, "d": -4.0})
    probabilities = found.probabilities(settings)
    assert sum(probabilities.values()) == pytest.approx(1.0)
    effects = sum(p for name, p in probabilities.items() if name != "none")
    assert found.lacking(settings) == pytest.approx(effects)
    factors = np.exp([3.2, 1.0, -2.0, -4.0]).mean()  # prior: nothing as likely as all together
    assert found.lacking(settings) == pytest.approx(factors / (1.0 + factors))


@pytest.mark.parametrize("others", [0, 17])
def test_one_effect_among_many_needs_more_evidence(others, monkeypatch):
    """20 to 1 for one of 18 that are all as likely beforehand is not 3 to 1 that any is missing."""
    gains = {"friction": 3.2} | {f"other {k}": -3.0 for k in range(others)}
    path = Path([step(0.0, 1.0)], [contenders(gains)])
    better = step(9.0, 0.5, ("friction",))
    monkeypatch.setattr("qlvbayes.diagnosis.search.step_at", lambda *given: better)
    found = _confirmed(None, None, path, Settings())
    assert found is (None if others else better)


def test_a_better_one_that_was_refused_stays_a_rival():
    """Left-out tests can veto a name, not make another one sure."""
    path = Path([step(0.0, 1.0), step(1.0, 0.9, ("second",))])
    path.places = {"second": contenders({"first": 9.0, "second": 6.0, "third": 5.5, "last": 4.0})}
    assert [c.effect for c in rivals(path, Settings())] == ["second", "first", "third"]


@pytest.mark.parametrize(("gains", "left"), [((60.0, 4.5), ("a",)), ((60.0, 5.5), None)])
def test_an_effect_that_adds_little_beside_the_others_goes_again(gains, left, monkeypatch):
    path = Path([step(1.0, 0.9, ("a", "b"))])
    path.places = {name: contenders({name: gain}) for name, gain in zip("ab", gains, strict=True)}
    monkeypatch.setattr(
        "qlvbayes.diagnosis.swap.step_at", lambda ensemble, samples, effects, point: effects
    )
    assert _without_weakest(None, None, path, Settings()) == left


@pytest.mark.parametrize(
    ("gain", "score", "named"),
    [(84.0, 50.0, ("a", "b")), (4.5, 50.0, None), (84.0, -1.0, None)],
    ids=["both together", "the second adds too little", "left-out tests refuse both"],
)
def test_two_effects_of_which_neither_alone_is_confirmed(gain, score, named, monkeypatch):
    path = Path([step(0.0, 1.0)], [contenders({"a": 8.0, "b": 7.0})])
    path.refused = [("a", "why"), ("b", "why"), ("c", "why")]

    def tried(ensemble, samples, effects, point):
        return step(score if len(effects) == 2 else -3.0, 0.5, effects)

    monkeypatch.setattr("qlvbayes.diagnosis.search.step_at", tried)
    monkeypatch.setattr(
        "qlvbayes.diagnosis.search.contest", lambda *given, **how: contenders({"b": gain, "c": 1.0})
    )
    found = _with_another(None, None, path, "a", Settings())
    assert (found and found.effects) == named
    assert [one.effects for one in path.steps] == ([(), ("a",)] if named else [()])
    assert len(path.rounds) == len(path.steps)
    assert ("a", "why") not in path.refused if named else len(path.refused) == 3


@pytest.mark.parametrize(("missed", "kept"), [(-5.0, 868.0), (870.0, 870.0)])
def test_over_its_place_an_effect_is_worth_what_is_known(missed, kept, monkeypatch):
    """A refit that misses the last step's optimum does not make the effect worthless."""
    found = contenders({"other": 20.0, "adhesion": missed})
    found = replace(found, base=SimpleNamespace(log_evidence=100.0))
    last = SimpleNamespace(point=SimpleNamespace(log_evidence=968.0), effects=("adhesion",))
    monkeypatch.setattr("qlvbayes.diagnosis.swap.weighed", lambda ensemble, one, least: one)
    held = _held(None, found, last, "adhesion", Settings())
    assert [c.effect for c in held.contenders] == ["adhesion", "other"]
    assert held.best.log_bayes_factor == kept
    assert (held.best.point is last.point) == (missed < kept)
