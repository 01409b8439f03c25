"""Motions and steps to compare with the whole."""

import jax
import jax.numpy as jnp
import numpy as np

from qlvbayes import Model, Motion
from qlvbayes.laws import Prony
from qlvbayes.model.stepping import begin, begin_at_force, step, step_to_force

TIME = np.linspace(0.0, 4.0, 401)
DEPTH = np.interp(TIME, [0.0, 0.2, 2.0, 2.3, 3.0, 3.2], [0.0, 1.6, 1.6, -0.4, -0.4, 1.2])
SHALLOW = np.interp(TIME, [0.0, 0.2, 2.0, 2.5], [0.0, 1.6, 1.6, 1.3])
PRONY = Prony(jnp.array([0.3, 0.63, 0.07]), jnp.array([6.2, 0.14]))


def motion_of(time, depth):
    """A motion whose velocity at a point is that of the line which ends there."""
    velocity = np.concatenate([[0.0], np.diff(depth) / np.diff(time)])
    return Motion(*map(jnp.asarray, (time, depth, velocity, np.zeros_like(time))))


@jax.jit
def stepped(model, depth, dt):
    """Forces (N,) at the points of a motion with even steps."""

    def advance(state, place):
        return step(model, state, place, dt)

    first, force = step(model, begin(model, depth[0]), depth[0], 0.0)
    return jnp.concatenate([force[None], jax.lax.scan(advance, first, depth[1:])[1]])


@jax.jit
def solved(model, force, dt):
    """Displacements (N,) that give the forces."""

    def advance(state, force):
        return step_to_force(model, state, force, dt)

    first, place = begin_at_force(model, force[0])
    return jnp.concatenate([place[None], jax.lax.scan(advance, first, force[1:])[1]])


whole = jax.jit(Model.force)


def batch(model, depth):
    return np.asarray(whole(model, motion_of(TIME, depth)))


DT = TIME[1]


def relative(found, expected):
    return np.max(np.abs(np.asarray(found) - expected)) / np.max(np.abs(expected))
