"""Check the rules that every law has to keep, one by one or by one function."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import partial
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial.legendre import leggauss

from qlvbayes.io.catalogue import Check, run_checks
from qlvbayes.io.units import PAD
from qlvbayes.laws.elastic.law import AbstractElastic
from qlvbayes.laws.relaxation.law import MOST_TERMS, AbstractRelaxation
from qlvbayes.laws.scales import Scales
from qlvbayes.priors.distributions import AbstractPrior
from qlvbayes.xp import Array

_EXACT = 1e-9  # allowed error over the largest force or stiffness
_LENGTH = 2e-3  # of a step over the depth, as on the model's grid
_STEP_ERROR = 1e-5  # error over the integral, for laws whose step has no closed form;
# at first contact, where a power is not smooth, over the largest force: a tenth of the error that
_TOUCH_ERROR = 1e-5  # the straight lines of the model's grid may add
_DECAYS = (0.0, 1e-3, 0.3, 3.0)  # rate times step: zero, where a series is used, and above
_PANELS = 64  # panels of the quadrature of a step, with 8 nodes each
_NODES, _WEIGHTS = leggauss(8)
_ROUNDING = 1e-12  # allowed rounding error of a relaxation's curve and fractions
_BEYOND = 10.0  # factor by which the times checked exceed those of the tests, at both ends


class LawError(AssertionError):
    """Exception for a law that breaks a rule; the text says which rule."""


Law = TypeVar("Law", bound=AbstractElastic | AbstractRelaxation)
Words = tuple[str, ...]

_DRAWS = 16  # draws from the priors; every rule is checked at each
# the scales of the paper's tests, used where no others are given
_SCALES = Scales(force=1.6, depth=1.6, shortest=1e-3, longest=30.0, white=6e-3, ou=8e-3, tau=0.5)


def check_law(
    kind: type[AbstractElastic] | type[AbstractRelaxation], scales: Scales | None = None
) -> None:
    """Check that an elastic law or a relaxation law keeps the rules on which the model relies.

    Every law has to declare its name, units, meanings, formula and reference. The other rules are
    checked at draws from its default priors. An elastic law has no force at zero depth, its
    stiffness is the slope of its force, and its step equals the integral that it stands for. A
    relaxation law has g(0) = 1 and falls; its fractions are not negative and sum to 1; its rates
    are finite, above 0, at most 60, and as many whatever the constants are. Values and slopes are
    finite, and compiled and plain evaluation agree. A LawError has a line for each rule that is
    broken.

    Parameters
    ----------
    kind, scales
        The law's class; the scales of the tests, by default those of the paper.
    """
    run_checks(law_checks(kind, scales), LawError)


def law_checks(
    kind: type[AbstractElastic] | type[AbstractRelaxation], scales: Scales | None = None
) -> Iterator[Check]:
    """Yield name and function of each check of `check_law`, so that each is its own test.

    Parameters
    ----------
    kind, scales
        As there: ``@pytest.mark.parametrize(("name", "check"), law_checks(MyLaw))``.
    """
    yield "declarations", partial(_check_declarations, kind)
    limits = scales or _SCALES
    rng = np.random.default_rng(0)
    laws = [_drawn(kind.default(limits), rng) for _ in range(_DRAWS)]
    times = np.geomspace(limits.shortest / _BEYOND, limits.longest * _BEYOND, 60)
    rules, points = (
        (_OF_ELASTIC, jnp.linspace(0.0, limits.depth, 41))
        if issubclass(kind, AbstractElastic)
        else (_OF_RELAXATION, jnp.asarray(times))
    )

    def every(rule: Callable[[Any, Array], None]) -> None:
        for law in laws:
            rule(law, points)

    for name, rule in rules.items():
        yield name, partial(every, rule)


def _drawn(law: Law, rng: np.random.Generator) -> Law:
    """Return the law with numbers drawn from its priors."""
    leaves, shape = jax.tree.flatten(law, is_leaf=lambda x: isinstance(x, AbstractPrior))
    drawn = [np.asarray(x.draw(rng)) if isinstance(x, AbstractPrior) else x for x in leaves]
    return jax.tree.map(jax.numpy.asarray, jax.tree.unflatten(shape, drawn))


def _check_declarations(kind: type[AbstractElastic] | type[AbstractRelaxation]) -> None:
    own = {f.name for f in fields(kind) if not f.metadata.get("static", False)}
    check_words(kind, own, ("units", "meanings"), ("law", "reference"), LawError)


def check_words(
    kind: Any, own: set[str], by_constant: Words, lines: Words, error: type[AssertionError]
) -> None:
    """Check that a class says what it has to of each of its ``own`` constants, and in one line."""
    if inspect.isabstract(kind):
        raise error(f"{kind.__name__} lacks {', '.join(sorted(kind.__abstractmethods__))}")
    for word in by_constant:
        if set(getattr(kind, word)) != own:
            raise error(
                f"{kind.name}: {word} must name exactly its constants {', '.join(sorted(own))}"
            )
    for constant, unit in kind.units.items():
        if not PAD.knows(unit):
            raise error(
                f"{kind.name}: {unit!r} is no kind of unit (units[{constant!r}]); the kinds are "
                f"{', '.join(PAD.kinds)}"
            )
    for word in ("name", *lines):
        text = getattr(kind, word)
        if not text.strip() or "\n" in text:
            raise error(f"{kind.__name__}: {word} must be one line of text")


def _check_force(law: AbstractElastic, depths: Array) -> None:
    force, stiffness = law.force(depths), law.stiffness(depths)
    if force.shape != depths.shape or stiffness.shape != depths.shape:
        raise LawError(f"{law}: force and stiffness must have the shape of the depth")
    if not np.all(np.isfinite(force)) or not np.all(np.isfinite(stiffness)):
        raise LawError(f"{law}: force or stiffness is not finite")
    if abs(float(force[0])) > _EXACT * float(jnp.max(jnp.abs(force))):
        raise LawError(f"{law}: the force at zero depth is {float(force[0]):.3g}, not zero")
    slope = _slope_of_force(law, depths[1:])
    error = float(jnp.max(jnp.abs(slope - stiffness[1:])) / jnp.max(jnp.abs(stiffness)))
    if not error <= _EXACT:
        raise LawError(f"{law}: stiffness is off the slope of the force by {error:.1e}")


@eqx.filter_jit
def _slope_of_force(law: AbstractElastic, depths: Array) -> Array:
    return jax.vmap(jax.grad(law.force))(depths)


def _check_steps(law: AbstractElastic, depths: Array) -> None:
    depth = float(depths[-1])
    starts = [0.0, 0.15 * depth, 0.6 * depth]
    pairs = [(x, y) for x in starts for y in (x + _LENGTH * depth, max(x - _LENGTH * depth, 0.0))]
    start, stop, decay = np.array([(*pair, decay) for pair in pairs for decay in _DECAYS]).T
    given = [jnp.asarray(x) for x in (start, stop, decay)]
    plain, compiled, exact = (
        np.asarray(run(law, *given)) for run in (_step, _compiled_step, _integrals)
    )
    most = abs(float(law.force(jnp.asarray(depth))))
    least = np.where(start == 0.0, _TOUCH_ERROR * most, 0.0)
    allowed = np.maximum(_STEP_ERROR * np.maximum(np.abs(exact), _LENGTH * most), least)
    for k in np.flatnonzero(~np.isclose(plain, compiled, rtol=1e-10, atol=1e-14)):
        raise LawError(
            f"{law}: compiled and plain steps differ: {compiled[k]:.12g}, {plain[k]:.12g}"
        )
    for k in np.flatnonzero(~(np.abs(plain - exact) <= allowed)):
        raise LawError(
            f"{law}: the step from {start[k]:.3g} to {stop[k]:.3g} at a decay of {decay[k]:g} "
            f"is {plain[k]:.6g}, its integral {exact[k]:.6g}"
        )


def _step(law: AbstractElastic, start: Array, stop: Array, decay: Array) -> Array:
    return law.relaxed_step(start, stop, law.force(start), law.force(stop), decay)


_compiled_step = eqx.filter_jit(_step)  # once for all draws of a law


@eqx.filter_jit
def _integrals(law: AbstractElastic, start: Array, stop: Array, decay: Array) -> Array:
    """Return the integrals of e^{-decay (1 - s)} K(depth(s)) over each step, shape (N,) in N."""
    edges = np.linspace(0.0, 1.0, _PANELS + 1) ** 3
    half = 0.5 * np.diff(edges)[:, None]
    s = edges[:-1, None] + half * (1.0 + _NODES)

    def one(start: Array, stop: Array, decay: Array) -> Array:
        stiffness = law.stiffness(start + (stop - start) * s)
        return jnp.sum(half * _WEIGHTS * jnp.exp(-decay * (1.0 - s)) * stiffness) * (stop - start)

    return jax.vmap(one)(start, stop, decay)


@eqx.filter_jit
def _slopes_of_steps(law: AbstractElastic, depths: Array) -> AbstractElastic:
    """Return the slopes, along the constants, of the sum of all forces and steps."""

    def total(law: AbstractElastic) -> Array:
        force = law.force(depths)
        step = law.relaxed_step(depths[:-1], depths[1:], force[:-1], force[1:], jnp.asarray(0.1))
        rest = law.relaxed_step(depths, depths, force, force, jnp.asarray(0.1))
        return jnp.sum(step) + jnp.sum(rest) + jnp.sum(force)

    return jax.grad(total)(law)


def _check_spectrum(law: AbstractRelaxation, time: Array) -> None:
    fractions, rates = law.spectrum()
    if fractions.shape != (rates.shape[0] + 1,):
        raise LawError(f"{law}: a spectrum has one fraction more than rates")
    if rates.size > MOST_TERMS:
        raise LawError(f"{law}: the spectrum has {rates.size} rates, more than {MOST_TERMS}")
    if not np.all(np.isfinite(fractions)) or not np.all(np.isfinite(rates)):
        raise LawError(f"{law}: the spectrum is not finite")
    if np.min(fractions) < 0.0:
        raise LawError(f"{law}: a fraction of the spectrum is negative")
    if abs(float(jnp.sum(fractions)) - 1.0) > _ROUNDING:
        raise LawError(f"{law}: the fractions sum to {float(jnp.sum(fractions)):.12g}, not 1")
    if np.min(rates) <= 0.0:
        raise LawError(f"{law}: a rate of the spectrum is not above 0")
    if not all(float(x) > 0.0 for x in law.times().values()):
        raise LawError(f"{law}: its times must be above 0")


def _check_curve(law: AbstractRelaxation, time: Array) -> None:
    curve = law.curve(jnp.concatenate([jnp.zeros(1), time]))
    if abs(float(curve[0]) - 1.0) > _ROUNDING or np.max(np.diff(curve)) > _ROUNDING:
        raise LawError(f"{law}: g must begin at 1 and fall")
    compiled = _compiled_curve(law, time)
    if not np.allclose(compiled, curve[1:], rtol=0.0, atol=1e-10):
        raise LawError(f"{law}: compiled and plain evaluation differ")


_compiled_curve = eqx.filter_jit(lambda law, time: law.curve(time))  # once for all draws of a law


_slopes_of_curve = eqx.filter_jit(lambda law, time: jax.jacfwd(lambda law: law.curve(time))(law))


def _check_slopes(slopes: Callable[[Any, Array], Any], law: Any, points: Array) -> None:
    if not all(np.all(np.isfinite(slope)) for slope in jax.tree.leaves(slopes(law, points))):
        raise LawError(f"{law}: a slope along one of its constants is not finite")


_OF_ELASTIC: dict[str, Callable[[Any, Array], None]] = {
    "force and stiffness": _check_force,
    "steps": _check_steps,
    "slopes": partial(_check_slopes, _slopes_of_steps),
}
_OF_RELAXATION: dict[str, Callable[[Any, Array], None]] = {
    "spectrum": _check_spectrum,
    "curve": _check_curve,
    "slopes": partial(_check_slopes, _slopes_of_curve),
}
