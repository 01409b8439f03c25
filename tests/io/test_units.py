"""Units follow from displacement and force, and suffixes convert exactly."""

import numpy as np
import pytest

from qlvbayes.io.units import PAD, STRAIN, SUFFIXES, column_name
from qlvbayes.laws.elastic.polynomial import HertzPower


def test_units_follow_from_displacement_and_force_and_columns_carry_suffixes():
    units = (PAD.displacement, PAD.force, *map(PAD.of, ("stiffness", "exponent", "rate", "speed")))
    assert units == ("mm", "N", "N/mm", "1/mm", "1/s", "mm/s")
    assert not PAD.bonded_default
    assert PAD.of(HertzPower.units["m"]) == "N/mm^n"
    assert STRAIN.of(HertzPower.units["m"]) == "kPa"
    units = (STRAIN.displacement, STRAIN.force, STRAIN.stiffness, STRAIN.of("exponent"))
    assert units == ("1", "kPa", "kPa", "1")
    assert (STRAIN.of("rate"), STRAIN.speed) == ("1/s", "1/s")
    assert STRAIN.bonded_default
    for scales in SUFFIXES.values():
        first = next(iter(scales.values()))
        assert (first.up, first.down) == (1, 1)
    assert column_name("force", "mN") == "force_mN"
    assert column_name("strain", "") == "strain"


@pytest.mark.parametrize(
    ("quantity", "suffix", "ours"),
    [("time", "ms", 0.001), ("time", "min", 60.0), ("displacement", "um", 0.001),
     ("displacement", "nm", 1e-6), ("displacement", "m", 1000.0), ("force", "mN", 0.001),
     ("force_sd", "uN", 1e-6), ("force", "nN", 1e-9), ("stress", "MPa", 1000.0),
     ("stress_sd", "Pa", 0.001), ("start", "min", 60.0), ("strain", "", 1.0)],
)  # fmt: skip
def test_one_of_a_unit_is_the_nearest_float_in_ours(quantity, suffix, ours):
    values = np.array([1.0])
    SUFFIXES[quantity][suffix].convert(values)
    assert values[0] == ours
