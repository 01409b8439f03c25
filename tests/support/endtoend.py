"""Offer what end-to-end tests share: the command, pad B and its fits, and the files' contract."""

import contextlib
import functools
import io
import json
import math
import os
import re
import sys
from pathlib import Path
from unittest import mock

from PIL import Image

from qlvbayes.cli.main import run
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.fit import fit_pad
from qlvbayes.io.data import read_measurements
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.pipeline.steps import Watcher
from qlvbayes.plots import files as plots_files
from qlvbayes.plots.catalogue import FIGURES
from qlvbayes.simulate import TABLE_1
from support.shared import once

PADS = Path(__file__).parents[2] / "data" / "pads.csv"
COMMAND = Path(sys.executable).with_name("qlvbayes")
TRUTH = TABLE_1["B"]
CONSTANTS = ["m", "b", "c[0]", "c[1]", "c[2]", "v[1]", "v[2]"]
SHORT = Settings(max_steps=40)


class Listener(Watcher):
    """A watcher that keeps what it is told."""

    def __init__(self):
        self.notices = []

    def starting(self, lines):
        self.notices += lines

    def notice(self, *texts):
        self.notices += texts


def with_tests(path, *tests, data=PADS):
    """Write some tests of a file of the package to a file of their own."""
    lines = data.read_text().splitlines(keepends=True)
    head = next(line for line in lines if not line.startswith("#"))
    column = head.split(",").index("test")
    rows = (line for line in lines if not line.startswith("#"))
    path.write_text(head + "".join(line for line in rows if line.split(",")[column] in tests))
    return path


def two_tests(path):
    """Write the hidden case's slow and fast test: enough to show a drag."""
    return with_tests(path, "C-1", "C-100", data=PADS.with_name("hidden.csv"))


def true_value(name):
    """The constant that pad B of the example data was simulated with."""
    stem, _, index = name.partition("[")
    value = getattr(TRUTH, stem)
    if not index:
        return value
    return value[int(index[:-1]) - (1 if stem == "v" else 0)]


def environment():
    """Return an environment in which stdout is buffered, as it is for users."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}


def call(*words, drawn=False):
    """Run the command here: status, stdout, stderr but for its time; drawn: its figures or some."""
    out, err = io.StringIO(), io.StringIO()
    line = ["qlvbayes", *map(str, words)]
    status = 0
    with (
        mock.patch.object(sys, "argv", line),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        contextlib.nullcontext() if drawn is True else undrawn(drawn or ()),
    ):
        try:
            run()
        except SystemExit as stop:
            status = stop.code or 0
    return (
        status,
        out.getvalue(),
        re.sub(r"^took [\d.]+ (s|min|h)\n", "", err.getvalue(), flags=re.M),
    )


@contextlib.contextmanager
def undrawn(but=()):
    """Figures are left out, but for some: an image of one pixel, a page without anything."""
    write = plots_files.save_figure

    def save(figure, path, *kinds):
        if path.name in but:
            return write(figure, path, *kinds)
        image = path.with_name(f"{path.name}.png")
        Image.new("L", (1, 1)).save(image)
        path.with_name(f"{path.name}.pdf").write_bytes(b"%PDF-1.4\n")
        return image

    with contextlib.ExitStack() as stack:
        stack.enter_context(mock.patch.object(plots_files, "save_figure", save))
        for one in FIGURES:
            if one.name not in but:
                name = f"qlvbayes.plots.{one.file or one.name}.plot_{one.name}"
                stack.enter_context(mock.patch(name, return_value=None))
        yield


@functools.cache
def study():
    return read_measurements(PADS)


@functools.cache
def experiment(pad="B"):
    return prepare(study().pad(pad))


@functools.cache
def fitted(choices=Choices(), method="emcee", settings=Settings(), pad="B"):  # noqa: B008
    def fit():
        return fit_pad(experiment(pad), choices, method=method, settings=settings)

    return once(fit, choices, method, settings, pad)


def read_json(path):
    """Read a JSON file; NaN and infinities are no JSON."""

    def refuse(token):
        raise ValueError(f"{token} is not JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def is_number(x):
    return isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x)


def keeps_summary_contract(content):
    assert content["schema"] == 1
    for key, kind in (
        ("pad", str),
        ("effects", list),
        ("sampler", str),
        ("converged", bool),
        ("parameters", dict),
    ):
        assert isinstance(content[key], kind), key
    parameters = content["parameters"]
    assert {"m", "c[0]", "c[1]", "v[1]"} <= set(parameters)
    assert any(name.startswith("noise.") for name in parameters)
    for name, parameter in parameters.items():
        assert isinstance(parameter["unit"], str), name
        assert all(is_number(parameter[key]) for key in ("mean", "sd", "median")), name
        for key in ("r_hat", "ess_bulk"):
            assert parameter[key] is None or is_number(parameter[key]), (name, key)
        low, high = parameter["hdi90"]
        assert is_number(low), name
        assert is_number(high), name
        assert low <= high, name


def keeps_check_contract(content):
    assert content["schema"] == 1
    assert isinstance(content["pad"], str)
    assert isinstance(content["effects"], list)
    assert is_number(content["noise_N"])
    assert content["cells"]
    for cell in content["cells"]:
        assert isinstance(cell["test"], str)
        assert cell["phase"] in {"ramp", "hold", "unload", "recovery"}
        assert cell["role"] in {"fit", "validate"}
        assert cell["rate_mm_s"] is None or is_number(cell["rate_mm_s"])
        assert all(is_number(cell[key]) for key in ("n", "rmse_N", "bias_N", "coverage90"))


def one_line(err):
    """The one line on stderr, without the command's name."""
    assert err.startswith("qlvbayes: ")
    assert err.count("\n") == 1
    assert err.endswith("\n")
    assert "Traceback" not in err
    return err.removeprefix("qlvbayes: ").strip()
