"""A pad that relaxes by a power law, written in closed form: the fit finds its constants again."""

import numpy as np
import pytest
from support.endtoend import call, read_json

M, C0, ALPHA, TAU = 0.8, 0.2, 0.3, 0.05  # N/mm, share, exponent, s
DEPTH, NOISE = 1.5, 0.004  # mm, N


def integral(u):
    """Integrate g = c0 + (1 - c0)(1 + u/tau)^(-alpha) from 0 to u."""
    u = np.maximum(u, 0.0)
    return C0 * u + (1.0 - C0) * TAU * ((1.0 + u / TAU) ** (1.0 - ALPHA) - 1.0) / (1.0 - ALPHA)


def rows(rate, rng):
    """A linear spring's ramp and hold: F = m rate (G(t) - G(t - T)), G the integral of g."""
    top = DEPTH / rate
    time = np.unique(np.concatenate([np.linspace(0.0, top, 150), np.arange(top, top + 20.0, 0.02)]))
    force = M * rate * (integral(time) - integral(time - top))
    force += NOISE * rng.standard_normal(time.size)
    depth = np.minimum(rate * time, DEPTH)
    return [
        f"A,A-{rate:g},{t:.6f},{d:.6f},{f:.6f}" for t, d, f in zip(time, depth, force, strict=True)
    ]


@pytest.mark.slow
def test_a_power_law_is_found_again(tmp_path):
    rng = np.random.default_rng(0)
    lines = [line for rate in (1.0, 5.0, 20.0) for line in rows(rate, rng)]
    data = tmp_path / "power.csv"
    data.write_text("\n".join(["pad,test,time_s,displacement_mm,force_N", *lines]) + "\n")
    words = ("--elastic", "linear", "--relaxation", "power-law", "--all-tests", "--noise", "white")
    status, _, err = call("fit", data, "-o", tmp_path / "out", *words, "--method", "least-squares")
    assert status == 0, err
    found = read_json(tmp_path / "out" / "A" / "summary.json")["parameters"]
    truth = {"m": M, "c0": C0, "alpha": ALPHA, "tau": TAU}
    for name, value in truth.items():
        constant = found[name]
        # 4 sds of the constant and 2 % for what the motion's smoothing of a kink costs
        assert abs(constant["median"] - value) < 4.0 * constant["sd"] + 0.02 * value, name
        assert constant["sd"] < 0.3 * value, name
