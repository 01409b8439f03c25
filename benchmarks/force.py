"""The force on full records: against lfilter, and its growth with length."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
from rivals import by_convolution, by_fft, by_lfilter, qlv_force
from timing import call_ms, in_new_process, peak_mb

from qlvbayes import Model, Motion
from qlvbayes.laws import Exponential, Prony
from qlvbayes.simulate import PAPER_RATES, TABLE_1, Platen, paper_protocol

LENGTHS = (10_000, 100_000, 1_000_000, 10_000_000)
RIVALS = {by_lfilter: 10_000_000, by_fft: 10_000_000, by_convolution: 100_000}
"""How the fading of the past is summed, and up to how many samples that is waited for."""


def pad_model():
    pad = TABLE_1["B"]
    c, v = jnp.array(pad.c), jnp.array(pad.v)
    return Model(Exponential(jnp.array(pad.m), jnp.array(pad.b)), Prony(c, v))


force = jax.jit(jax.vmap(lambda model, motion: model.force(motion), in_axes=(None, 0)))


def full_record():
    """Six tests of the paper's protocol at 1 kHz, cut to a common length: (6, N)."""
    platens = [Platen(paper_protocol(rate)) for rate in PAPER_RATES]
    length = round(sum(p.duration for p in platens) * 1000 / len(platens))
    time = np.arange(length) / 1000.0
    depth = np.stack([platen.displacement(np.minimum(time, platen.duration)) for platen in platens])
    return np.broadcast_to(time, depth.shape).copy(), depth


def pad_constants():
    pad = TABLE_1["B"]
    return pad.m, pad.b, np.array(pad.c), np.array(pad.v)


def against_lfilter():
    time, depth = full_record()
    constants = pad_constants()
    zero = jnp.zeros_like(depth)
    motion = Motion(jnp.asarray(time), jnp.asarray(depth), zero, zero, jnp.zeros(len(depth)))
    model = pad_model()
    ours, rival = call_ms(force, model, motion), call_ms(qlv_force, constants, time, depth)
    # where contact is lost the pad cannot pull, which the rival's bare law does not know
    expected = np.maximum(qlv_force(constants, time, depth), 0.0)
    error = float(np.max(np.abs(np.asarray(force(model, motion)) - expected)))
    return depth.size, ours, rival, error


def growth():
    """(samples, ms, ns a sample, peak MB, ms of each rival) of each length, in its own process.

    A rival that would take minutes is nan.
    """
    rows = []
    for length in LENGTHS:
        taken, peak, *others = map(float, in_new_process(__file__, length).split())
        rows.append((length, taken, 1e6 * taken / length, peak, *others))
    return rows


def rivals_ms(constants, time, depth):
    """Milliseconds of each of RIVALS."""
    return [
        call_ms(qlv_force, constants, time, depth, rival, repeats=3)
        if depth.size <= most
        else np.nan
        for rival, most in RIVALS.items()
    ]


if __name__ == "__main__":
    count = int(sys.argv[1])
    t = jnp.arange(count)[None] * 1e-3
    zero = jnp.zeros_like(t)
    depth = 0.8 * (1.0 - jnp.cos(t))
    one = Motion(t, depth, zero, zero, jnp.zeros(1))
    taken, peak = call_ms(force, pad_model(), one, repeats=5), peak_mb()
    rivals = rivals_ms(pad_constants(), np.asarray(t), np.asarray(depth))
    print(taken, peak, *rivals)
