"""A fitted specimen to step in a control loop: force of the next displacement, and back."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from qlvbayes.comparison.side import Source, side_of
from qlvbayes.effects.sensors import LINES, ChannelLag
from qlvbayes.io.arrays import Array as Floats
from qlvbayes.io.checks import InputError
from qlvbayes.model.model import Model
from qlvbayes.model.stepping import State, begin, check_inverse, check_steps, step, step_to_force

_begun = jax.jit(jax.vmap(begin))
_forward = jax.jit(jax.vmap(step, in_axes=(0, 0, 0, None)))
_inverse = jax.jit(jax.vmap(step_to_force, in_axes=(0, 0, 0, None)))


class Stepper:
    """Posterior draws of one specimen, stepped together in even steps from rest at zero.

    Displacement is linear over a step, for which the step is exact, whatever ``dt``. A step costs
    O(modes), however many went before. Values are in the units of the fit.

    Parameters
    ----------
    source
        A fit, a results file (`load_results`), draws by the constants' names, or a model whose
        constants are scalars.
    dt
        Length of a step (s).
    draws
        Number of posterior draws, evenly out of all; one is their mean.

    Examples
    --------
    >>> model = Model(Linear(0.5), Prony(np.array([0.4, 0.6]), np.array([2.0])))
    >>> pad = Stepper(model, dt=0.1)
    >>> force = pad.force(0.2)
    >>> force.round(6)
    array([0.094381])
    >>> pad.displacement(force).round(4)
    array([0.2209])

    Raises
    ------
    InputError
        An effect of the fit does not go step by step; it names it. Or ``dt`` or ``draws`` is not
        above 0, or constants are missing.
    """

    def __init__(self, source: Source | Model, dt: float, draws: int = 64) -> None:
        if not (np.isfinite(dt) and dt > 0.0):
            raise InputError(f"a step of {dt} s", remedy="give a dt above 0")
        if draws < 1:
            raise InputError(f"{draws} draws", remedy="use one or more")
        self._models = _models(source, draws)
        check_steps(self._models)
        _check_lag(self._models, float(dt))
        self.dt = float(dt)
        self.draws = len(jax.tree.leaves(self._models)[0])
        self._state = _begun(self._models, jnp.zeros(self.draws))
        self._answer: Floats | None = None

    def force(self, next_displacement: ArrayLike) -> Floats:
        """Return the force (draws,) in N after a step of the platen.

        ``next_displacement`` (mm) is that at the end of the step: one value for all draws, or
        (draws,). An InputError where it has another shape or is not finite.
        """
        return self._take(_forward, next_displacement)

    def displacement(self, next_force: ArrayLike) -> Floats:
        """Return the displacement (draws,) in mm with which each draw has a force after a step.

        Each draw's platen goes there. To send one command to all, save ``state``, ask, ``restore``
        it and step with `force`. A loose specimen carries no force below zero; there the platen
        rests on its surface. ``next_force`` (N) is that at the end of the step: one value for all
        draws, or (draws,). An InputError, with the state as it was, where no displacement has the
        force; or where the model has a channel_lag, whose reading is of an earlier time.
        """
        check_inverse(self._models)
        return self._take(_inverse, next_force)

    def band(self, share: float = 0.9) -> tuple[float, float]:
        """Return the ends of the middle ``share`` of the last answer, after a first step."""
        if self._answer is None:
            raise InputError("no step was made yet", remedy="ask for a force or a displacement")
        low, high = np.quantile(self._answer, [0.5 - 0.5 * share, 0.5 + 0.5 * share])
        return float(low), float(high)

    @property
    def state(self) -> State:
        """Memory of all draws, as numpy arrays: one value a mode, and the depth."""
        return jax.tree.map(np.array, self._state)

    def restore(self, state: State) -> None:
        """Continue from a ``state`` of this stepper; an InputError where it is another model's."""
        parts = (jax.tree.flatten(x) for x in (state, self._state))
        given, own = ((list(map(np.shape, leaves)), structure) for leaves, structure in parts)
        if given != own:
            raise InputError("a state of another model", remedy="restore what .state gave")
        self._state, self._answer = state, None

    def _take(self, function, value: ArrayLike) -> Floats:  # type: ignore[no-untyped-def]
        given = np.asarray(value, dtype=float)
        if given.shape not in ((), (self.draws,)) or not np.all(np.isfinite(given)):
            raise InputError(
                f"a next value of shape {given.shape}, or one that is not finite",
                remedy=f"give one number, or {self.draws} for {self.draws} draws",
            )
        full = np.broadcast_to(given, (self.draws,))
        state, computed = function(self._models, self._state, full, self.dt)
        answer = np.asarray(computed)
        if lost := int(np.sum(np.isnan(answer))):
            raise InputError(
                f"{lost} of {self.draws} draws have no displacement with this force",
                remedy="ask for a smaller force",
            )
        self._state, self._answer = state, answer
        return answer


def _models(source: Source | Model, draws: int) -> Model:
    """Return a model whose constants have a leading axis, of at most so many draws."""
    if isinstance(source, Model):
        return jax.tree.map(lambda x: jnp.asarray(x, dtype=float)[None], source)
    return side_of(source, "draws").some(draws).models


def _check_lag(models: Model, dt: float) -> None:
    """Raise InputError where more steps are on their way through a late channel than are kept."""
    for effect in models.effects:
        if isinstance(effect, ChannelLag) and (late := float(np.max(effect.delay))) > LINES * dt:
            raise InputError(
                f"{effect.name}: a delay of {late:.3g} s is more than {LINES} steps of {dt:g} s",
                remedy="use a longer dt",
            )
