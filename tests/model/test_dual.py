"""Displacement from a prescribed force: closed form, differential equations, there and back."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.stepped import PRONY, relative

from qlvbayes import InputError, Model, displacement_from_force
from qlvbayes.laws import Exponential, Linear, Prony


def test_creep_of_a_standard_linear_solid():
    """g = c0 + c1 e^{-vt} under a dead weight F: d = (F/m)(1/c0 + (1 - 1/c0) e^{-c0 v t})."""
    m, c0, v, load = 0.5, 0.3, 2.0, 0.4
    model = Model(Linear(m), Prony(jnp.array([c0, 1.0 - c0]), jnp.array([v])))
    errors = []
    for points in (301, 601, 1201):
        time = np.linspace(0.0, 6.0, points)
        exact = load / m * (1.0 / c0 + (1.0 - 1.0 / c0) * np.exp(-c0 * v * time))
        found = displacement_from_force(model, time, np.full(points, load))
        errors.append(relative(found, exact))
    assert errors[0] < 1e-5
    # lines between the points: of second order
    assert np.allclose(np.array(errors[:-1]) / errors[1:], 4.0, rtol=0.02)


def radau(model, force, rate, until):
    """d' = (F' + sum c v q)/K(d), q' = K d' - v q: the same law as differential equations."""
    m, b = float(model.elastic.m), float(model.elastic.b)
    c, v = np.asarray(model.relaxation.c), np.asarray(model.relaxation.v)

    def slopes(t, y):
        stiffness = m * np.exp(b * y[0])
        speed = (rate(t) + np.sum(c[1:] * v * y[1:])) / stiffness
        return np.concatenate([[speed], stiffness * speed - v * y[1:]])

    instant = np.log1p(force(0.0) * b / m) / b
    start = np.concatenate([[instant], np.full(v.size, force(0.0))])
    return solve_ivp(
        slopes, (0.0, until), start, method="Radau", rtol=1e-10, atol=1e-12, dense_output=True
    ).sol


@pytest.mark.parametrize("load", ["dead weight", "sine"])
@pytest.mark.few(1)
def test_an_exponential_law_against_a_stiff_solver(load):
    model = Model(Exponential(0.34, 1.165), PRONY)
    swing, omega = (0.0, 1.0) if load == "dead weight" else (0.4, 3.0)

    def force(t):
        return 1.0 + swing * np.sin(omega * t)

    exact = radau(model, force, lambda t: swing * omega * np.cos(omega * t), 20.0)
    errors = []
    for points in (2001, 4001):
        time = np.linspace(0.0, 20.0, points)
        found = displacement_from_force(model, time, force(time))
        errors.append(relative(found, exact(time)[0]))
    assert errors[0] < 3e-5
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


def test_a_stiff_record_from_milliseconds_to_hours():
    """Points that grow apart by six decades, against rates five decades apart."""
    relaxation = Prony(jnp.array([0.3, 0.4, 0.3]), jnp.array([50.0, 5e-4]))
    model = Model(Exponential(0.34, 1.165), relaxation)
    time = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, 4000)])
    found = displacement_from_force(model, time, np.ones(time.size))
    exact = radau(model, lambda t: 1.0 + 0.0 * t, lambda t: 0.0, 1e4)
    assert relative(found, exact(time)[0]) < 1e-5


def test_what_cannot_be_done_is_told_in_one_line():
    model = Model(Linear(0.5), PRONY)
    with pytest.raises(InputError, match="rows of one length"):
        displacement_from_force(model, [0.0, 1.0], [0.0])
    with pytest.raises(InputError, match="time runs back"):
        displacement_from_force(model, [0.0, 1.0, 0.5], np.zeros(3))
