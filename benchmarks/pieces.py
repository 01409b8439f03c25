"""A hypothesis's force on arrays of NumPy, against the same model compiled by JAX."""

import time

import jax
import numpy as np

from qlvbayes import read_study
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.model.parameters import filled
from qlvbayes.motion.experiment import prepare
from qlvbayes.motion.record import with_zeros

REPEATS = 7  # of some calls each: the two take turns, and the quickest counts
CALLS = 10
SETS = 8  # of constants in a call, as many as a slope asks for
PLAIN = Hypothesis("exponential", "prony:2")
TOGETHER = (("friction", "viscous_drag"), ("channel_lag", "frame_compliance"))


def rows(file="data/hidden.csv"):
    """(hypothesis, first call s, us a set by NumPy, us a set by JAX)."""
    space = build_search(prepare(read_study(file).pads[0])).density.space
    found = []
    for hypothesis in _hypotheses(space):
        own = space.parameters(hypothesis)
        constants = own.constants(space.prior_draws(hypothesis)[:SETS])
        start = time.perf_counter()
        space.forces(hypothesis, constants)
        first = time.perf_counter() - start
        found.append((_name(hypothesis), first, *_in_turn(space, hypothesis, constants)))
    return found


def _hypotheses(space):
    yield PLAIN
    yield from (Hypothesis(law, "prony:2") for law in space.elastic if law != "exponential")
    yield from (Hypothesis("exponential", law) for law in space.relaxation if law != "prony:2")
    for effects in (*((name,) for name in space.effects), *TOGETHER):
        yield Hypothesis("exponential", "prony:2", frozenset(effects))


def _name(hypothesis):
    laws = [hypothesis.elastic] * (hypothesis.elastic != PLAIN.elastic)
    laws += [hypothesis.relaxation] * (hypothesis.relaxation != PLAIN.relaxation)
    return " + ".join([*laws, *sorted(hypothesis.effects)]) or "exponential, prony:2"


def _in_turn(space, hypothesis, constants):
    """Quickest microseconds a set: by NumPy, and by one call of one compiled function."""
    record = with_zeros(space.record, "sagitta", float)
    own = space.parameters(hypothesis)

    def one(row, motion):
        return filled(own.model, row).force(motion)

    whole = jax.jit(jax.vmap(jax.vmap(one, in_axes=(0, None)), in_axes=(None, 0)))
    calls = (
        lambda: space.forces(hypothesis, constants),
        lambda: np.asarray(whole(constants, record.motion)),
    )
    best = [np.inf, np.inf]
    calls[1]()
    for _ in range(REPEATS):
        for k, call in enumerate(calls):
            start = time.perf_counter()
            for _ in range(CALLS):
                call()
            best[k] = min(best[k], (time.perf_counter() - start) / CALLS)
    return [1e6 * seconds / SETS for seconds in best]


if __name__ == "__main__":
    for name, first, ours, alone in rows():
        print(f"{name}\t{first:.2f}\t{ours:.0f}\t{alone:.0f}\t{ours / alone:.2f}", flush=True)
