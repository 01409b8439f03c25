"""The MATLAB function, run by GNU Octave: the force of the Python model, and the way back."""

import subprocess

import numpy as np
import pytest
from support.exported_pad import exported
from support.lawmotions import LAWS, python_force, retracting
from support.octave import OCTAVE

from qlvbayes.model.choices import Choices
from qlvbayes.use.exports.matlab import MatlabFunction

pytestmark = pytest.mark.skipif(
    OCTAVE is None, reason="no GNU Octave here: the function is not run"
)

SCRIPT = """
for law = 1:numel(folders)
  cd(folders{law});
  clear pad_B
  state = pad_B('init');
  back = pad_B('init');
  out = zeros(numel(time), 4);
  before = time(1);
  for i = 1:numel(time)
    h = time(i) - before;
    before = time(i);
    [force, state] = pad_B('force', depth(i), h, state);
    [found, back] = pad_B('displacement', force, h, back);
    out(i, :) = [force, state.contact, found, back.contact];
  end
  dlmwrite('out.txt', out, 'precision', '%.17g');
end
[found, back] = pad_B('displacement', NaN, 1, back);
dlmwrite('nan.txt', found);
"""
CASES = [*((law, False) for law in LAWS), ("exponential", True)]


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Every law's pad and what Octave made of it, from one start of Octave."""
    root = tmp_path_factory.mktemp("octave")
    time, depth = (x[::2] for x in retracting())  # Octave takes a millisecond a step
    pads = []
    for i, (law, bonded) in enumerate(CASES):
        pad = exported(root / str(i), Choices(elastic=law, bonded=bonded))
        (root / str(i) / "pad_B.m").write_bytes(MatlabFunction().files(pad, None)["pad_B.m"])
        pads.append(pad)
    names = ", ".join(f"'{root / str(i)}'" for i in range(len(CASES)))
    numbers = [
        f"{key} = [{' '.join(map(repr, x.tolist()))}];"
        for key, x in (("time", time), ("depth", depth))
    ]
    script = root / "every_law.m"
    script.write_text(f"folders = {{{names}}};\n" + "\n".join(numbers) + SCRIPT)
    command = [OCTAVE, "--norc", "--no-history", "--quiet", str(script)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return root, pads, time, depth


@pytest.mark.parametrize("case", range(len(CASES)))
@pytest.mark.few(1)
def test_force_and_displacement_are_those_of_the_python_model(ran, case):
    root, pads, time, depth = ran
    force, contact, found, _ = np.loadtxt(root / str(case) / "out.txt", delimiter=",").T
    expected = python_force(pads[case], time, depth)
    assert np.max(np.abs(force - expected)) <= 1e-12 * np.max(expected)
    bonded = CASES[case][1]
    assert np.array_equal(contact > 0.5, (expected > 0.0) | bonded)
    left = np.flatnonzero((contact < 0.5) & (np.arange(time.size) > 0))
    until = left[0] if left.size else time.size
    assert until > 25
    assert np.max(np.abs(found - depth)[:until]) <= 1e-12


def test_a_force_that_is_no_number_gives_none(ran):
    root, _, _, _ = ran
    assert np.isnan(np.loadtxt(root / str(len(CASES) - 1) / "nan.txt"))
