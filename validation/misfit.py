"""Count how often 90 % intervals hold a pad's constants where the fit lacks a hidden effect.

One test at 20 mm/s of the paper's three pads, an effect of 3 to 10 % of the peak force hidden in
each, fitted by the plain model. Prints a line a fit, and the share over all constants.
"""

from __future__ import annotations

import argparse

import numpy as np

from qlvbayes.evaluation.study import measured
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.fit import fit_pad
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.simulate import NOISES, TABLE_1, HiddenPad, paper_protocol, record_study
from qlvbayes.simulate.hidden.draw import draw_effect

EFFECTS = ("viscous_drag", "friction", "fluid_pressure", "contact_offset")
PEAKS = {"A": 1.3, "B": 1.6, "C": 2.2}  # N, about
ROWS = 300  # a test
STEPS = Settings(max_steps=2500)


def held(name: str, effect: str, seed: int) -> list[bool]:
    """Return whether the interval of each constant of a pad holds its true value."""
    pad, rng = TABLE_1[name], np.random.default_rng([7, seed])
    hidden = draw_effect(effect, rng, PEAKS[name], 1.6, 30.0, rng.uniform(0.03, 0.1), pad)
    pads = {name: HiddenPad(pad, (hidden,))}
    study = record_study(pads, {"20": paper_protocol(20.0)}, NOISES["correlated"], seed, ROWS)
    found = fit_pad(prepare(measured(study, name)), Choices(), settings=STEPS).summary()
    shares = {f"c[{k}]": value for k, value in enumerate(pad.c)}
    rates = {f"v[{k}]": value for k, value in enumerate(pad.v, start=1)}
    truth = {"m": pad.m, "b": pad.b, **shares, **rates}
    ends = {key: found[key].hdi90 for key in truth}
    return [ends[key][0] <= value <= ends[key][1] for key, value in truth.items()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pads", type=int, default=6, help="of each effect")
    every: list[bool] = []
    for seed in range(parser.parse_args().pads):
        for effect in EFFECTS:
            name = sorted(TABLE_1)[seed % len(TABLE_1)]
            found = held(name, effect, seed)
            every += found
            print(f"{name} {effect}: {sum(found)} of {len(found)}", flush=True)
    print(f"{np.mean(every):.1%} of {len(every)} intervals hold the truth")


if __name__ == "__main__":
    main()
