"""Times that one pad's tests hold, and another's do not."""

import json

import numpy as np
import pytest
from support.endtoend import call
from support.solids import solid

from qlvbayes.comparison.side import Side, unheld_times
from qlvbayes.io.units import PAD
from qlvbayes.model.choices import Choices
from qlvbayes.motion.facts import Covered


def side(name, rates, hold, quickest=0.5):
    draws = {"m": 1.0, "b": 0.5, "c[0]": 0.4, "c[1]": 0.3, "c[2]": 0.3}
    draws |= {f"v[{k}]": v for k, v in enumerate(rates, 1)}
    table = np.array([list(draws.values())] * 20)
    reach = Covered(1.0, 1.0, 2.0, quickest, hold, 1)
    return Side(name, tuple(draws), table, Choices(), PAD, reach)


def test_times_that_a_test_does_not_hold_are_told():
    long, short = side("long", (1.0, 0.03), 180.0), side("short", (2.0, 0.3), 7.0)
    (notice,) = unheld_times([long, short])
    assert notice == "1/v[2] of long is 33 s, and short was held for 7 s"
    assert not unheld_times([side("a", (1.0, 0.3), 180.0), short])  # both hold all times
    assert not unheld_times([long, side("b", (1.0, 0.03), 170.0)])
    quick = side("quick", (100.0, 0.3), 7.0, quickest=0.05)
    assert "the quickest ramp of short took" in unheld_times([quick, short])[0]


@pytest.mark.slow
def test_one_material_held_long_and_short_is_not_called_different(tmp_path):
    """180 s and 7 s of one record, of a material of three times."""
    time = np.arange(0.0, 190.0, 0.1)
    way = np.minimum(time / 12.0, 0.75)
    elastic = 5.0 / 0.2 * np.expm1(0.2 * way)
    load = 0.4 * elastic + sum(solid(time, elastic, 0.0, 0.2, tau) for tau in (0.5, 5.0, 50.0))
    force = load + 0.004 * np.random.default_rng(3).standard_normal(time.size)
    rows = ["pad,test,time_s,displacement_mm,force_N"]
    for pad, last in (("long", 190.0), ("short", 16.0)):
        kept = time < last
        rows += [
            f"{pad},1,{t:.2f},{d:.5f},{f:.5f}"
            for t, d, f in zip(time[kept], way[kept], force[kept], strict=True)
        ]
    path = tmp_path / "two.csv"
    path.write_text("\n".join(rows) + "\n")
    assert call("fit", path, "-o", tmp_path / "out", "--max-steps", "3000")[0] == 0
    status, out, _ = call("compare", tmp_path / "out", "--json")
    (found,) = json.loads(out)
    assert status == 0
    assert found["differ"] is not True
    assert not [c for c in found["contrasts"] if c["group"] == "constants"]
    assert found["omnibus"]["over"] == "shown"
