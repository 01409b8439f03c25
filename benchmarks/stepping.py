"""Steps one by one from Python, and the dual problem against the force of the same test."""

import time

import jax
import jax.numpy as jnp
import numpy as np
from force import force, pad_model
from rivals import ivp_displacement
from timing import call_ms

from qlvbayes import Motion, Stepper, displacement_from_force
from qlvbayes.simulate import TABLE_1

LENGTHS = (1_000, 10_000, 100_000, 1_000_000)
IVP_LENGTHS = (1_000, 10_000)
DRAWS = (1, 64)
DT = 1e-3  # s


def posterior(count=1000):
    """Draws within a few per cent of pad B's constants: their values do not matter to the time."""
    pad, rng = TABLE_1["B"], np.random.default_rng(0)
    values = {"m": pad.m, "b": pad.b, "v[1]": pad.v[0], "v[2]": pad.v[1]}
    found = {name: x * np.exp(0.02 * rng.standard_normal(count)) for name, x in values.items()}
    shares = rng.dirichlet(2e3 * np.array(pad.c), count)
    return found | {f"c[{k}]": shares[:, k] for k in range(len(pad.c))}


def press(count):
    """A ramp to 1.6 mm in 80 ms, and a hold."""
    return 1.6 * np.minimum(DT * np.arange(1, count + 1) / 0.08, 1.0)


def steps_a_second(draws, count=3_000):
    """(force, displacement) steps a second of a Stepper, called from Python with all draws."""
    depths = press(count + 1)
    recorded = Stepper(posterior(), DT, draws=draws)
    loads = [recorded.force(depth) for depth in depths]
    forward, back = (Stepper(posterior(), DT, draws=draws) for _ in range(2))
    return [_rate(forward.force, depths), _rate(back.displacement, loads)]


def _rate(step, values):
    step(values[0])  # compiles
    start = time.perf_counter()
    for value in values[1:]:
        step(value)
    return (len(values) - 1) / (time.perf_counter() - start)


def dual_against_forward(count):
    """Milliseconds of the force of a test and of the displacement from it, and the way back."""
    model = jax.tree.map(jnp.asarray, pad_model())
    t, depth = jnp.asarray(DT * np.arange(1, count + 1)), jnp.asarray(press(count))
    zero = jnp.zeros_like(t)
    motion = Motion(t[None], depth[None], zero[None], zero[None], jnp.zeros(1))
    load = force(model, motion)[0]
    repeats = 5 if count <= 100_000 else 3
    forward = call_ms(force, model, motion, repeats=repeats)
    back = call_ms(displacement_from_force, model, t, load, repeats=repeats)
    error = jnp.max(jnp.abs(displacement_from_force(model, t, load) - depth))
    return forward, back, float(error)


def dual_against_ivp(count):
    """Milliseconds of a ramp of force and creep, by us and by scipy's LSODA, and their distance."""
    pad = TABLE_1["B"]
    constants = (pad.m, pad.b, np.array(pad.c), np.array(pad.v))
    time = DT * np.arange(count)
    load = np.minimum(time / 0.1, 1.0)
    model = jax.tree.map(jnp.asarray, pad_model())
    ours = call_ms(displacement_from_force, model, time, load, repeats=5)
    rival = call_ms(ivp_displacement, constants, time, load, repeats=3)
    apart = displacement_from_force(model, time, load) - ivp_displacement(constants, time, load)
    return ours, rival, float(np.max(np.abs(apart)))


if __name__ == "__main__":
    for draws in DRAWS:
        print("draws", draws, "steps/s force, displacement:", *map(round, steps_a_second(draws)))
    for count in LENGTHS:
        print("samples", count, "forward ms, dual ms, error mm:", *dual_against_forward(count))
    for count in IVP_LENGTHS:
        print("samples", count, "dual ms, LSODA ms, apart mm:", *dual_against_ivp(count))
