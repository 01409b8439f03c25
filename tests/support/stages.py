"""Recordings of one pad on one stage, whose contact lies at one crosshead coordinate in all."""

import numpy as np

from support.machine_files import Pressed


def film_press(speed, seed, *, eta=0.004, power=1.0, noise=0.003, step=0.0, approach=0.3):
    """A pad pressed to 1.5 mm under a film of drag eta v / (1 - d/3.5)^3, 200 Hz, contact at 0."""
    rng = np.random.default_rng(seed)
    rate = 200.0
    time = np.arange(int(rate * (0.5 + (approach + 1.5) / speed + 2.0))) / rate
    way = np.clip((time - 0.5) * speed - approach, -approach, 1.5)
    depth = np.maximum(way, 0.0)
    elastic = 0.8 * depth**power * np.exp(0.3 * depth)
    slow, memory = np.exp(-4.0 / rate), 0.0
    relaxed = np.empty_like(elastic)
    for k, rise in enumerate(np.diff(elastic, prepend=0.0)):
        memory = (memory + rise) * slow
        relaxed[k] = 0.6 * elastic[k] + 0.4 * memory
    drag = eta * np.gradient(way, time) * (way > 0.0) / (1.0 - depth / 3.5) ** 3
    load = relaxed + drag + noise * rng.standard_normal(time.size)
    return Pressed(time, way, np.round(load / step) * step if step else load)


def written(folder, name, test, contact, way=1.0):
    path = folder / f"{name}.csv"
    rows = zip(test.time, way * (test.way + contact), test.load, strict=True)
    lines = "".join(f"{t:.4f},{d:.4f},{f:.4f}\n" for t, d, f in rows)
    path.write_text("Time,Extension,Load\n(s),(mm),(N)\n" + lines)
    return path


def stage(folder, contact, speeds, *, way=1.0, **press):
    return [
        written(folder, f"at_{speed:g}", film_press(speed, seed, **press), contact, way)
        for seed, speed in enumerate(speeds)
    ]
