"""Derive comparisons, constants and forces from the results of pads in a folder.

Matplotlib is imported when something is drawn, so that the other steps do not wait for it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from qlvbayes.comparison.compare import REGION, compare
from qlvbayes.comparison.contrast import Comparison, write_comparison
from qlvbayes.fitting import summary
from qlvbayes.fitting.residuals import Curves
from qlvbayes.fitting.results import Saved, load
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import read_measurements
from qlvbayes.motion.facts import covered
from qlvbayes.parallel.running import package_digest
from qlvbayes.pipeline.source import REFERENCES
from qlvbayes.pipeline.steps import FITTED, Watcher, digest_of, is_finished, record_finished
from qlvbayes.report.page import MOST_ON_A_PAGE

FOLDER = "compare"
_MOST_PAIRS = 6  # most pairs that a study compares; beyond that the user names them
Group = tuple[str, Sequence[Saved]]


@dataclass(frozen=True)
class CompareStep:
    """Step that compares two groups of fits; it leaves a figure and tables in a folder of the pair.

    region: ratios from 1/(1 + region) to 1 + region count as equal; depth, rates, frequencies:
    where quantities are read, None for what the tests of both cover; seed: that of the draws.
    """

    name = "compare"
    code = (*FITTED, "comparison")

    region: float = REGION
    depth: float | None = None
    rates: tuple[float, ...] | None = None
    frequencies: tuple[float, ...] | None = None
    seed: int = 0

    def run(self, out: Path, first: Group, second: Group, watcher: Watcher) -> Comparison:
        """Compare the groups in ``out/compare``; one that is finished is read."""
        names = first[0], second[0]
        folder = out / FOLDER / f"{names[0]}-vs-{names[1]}"
        fits = (*first[1], *second[1])
        facts = [(x.pad, x.fluid, x.covered) for x in fits]
        digests = [hashlib.sha256(x.draws.tobytes()).hexdigest() for x in fits]
        parts = (self, *names, facts, digests, package_digest(self.code))
        key = hashlib.sha256(repr(parts).encode()).hexdigest()
        if is_finished(out, self.name, folder.name, key, folder):
            return Comparison.read(folder / "compare.json")
        from qlvbayes.plots.contrasts import plot_contrasts
        from qlvbayes.plots.files import save_figure

        with watcher.doing(f"comparing {names[0]} with {names[1]}"):
            comparison = compare(first[1], second[1], names=names, **vars(self))
            files = write_comparison(folder, comparison)  # which makes the folder
            files.append(save_figure(plot_contrasts(comparison), folder / "contrasts"))
        record_finished(out, self.name, folder.name, key, {f.name: digest_of(f) for f in files})
        return comparison


def figure_of(out: Path, comparison: Comparison) -> Path:
    """Return the path of a comparison's figure."""
    return out / FOLDER / "-vs-".join(comparison.names) / "contrasts.png"


def saved_pads(out: Path, names: Sequence[str] = (), data: Path | None = None) -> list[Saved]:
    """Return the fits of named pads in a folder, by default all; InputError if there are none.

    A posterior made elsewhere does not say what its tests cover: the measurements do.
    """
    read = cache(read_measurements)
    fits = []
    for name in names or fitted_pads(out):
        saved = load(out / name / "posterior.nc")
        source = data or Path(saved.source)
        if saved.covered is None and source.is_file():
            pad = read(source).pad(saved.pad)
            tested, fluid = covered(saved.choices.prepare(pad)), saved.fluid or pad.fluid
            saved = replace(saved, covered=tested, fluid=fluid)
        fits.append(saved)
    return fits


def fitted_pads(out: Path) -> list[str]:
    """Return the names of the pads whose fits are in a folder; InputError if there are none."""
    names = sorted(file.parent.name for file in out.glob("*/posterior.nc"))
    if not names:
        raise InputError("no fit in this folder", file=out, remedy="run qlvbayes fit first")
    return names


def pad_pairs(pads: Sequence[Saved]) -> list[tuple[Group, Group]]:
    """Return every pair of pads."""
    return list(combinations([(saved.pad, [saved]) for saved in pads], 2))


def fluid_pairs(pads: Sequence[Saved]) -> list[tuple[Group, Group]]:
    """Return every pair of fluids of which there are two specimens or more."""
    fluids: dict[str, list[Saved]] = {}
    for saved in pads:
        if saved.fluid:
            fluids.setdefault(saved.fluid, []).append(saved)
    several = [(fluid, group) for fluid, group in fluids.items() if len(group) > 1]
    return list(combinations(several, 2))


def not_all_compared(head: str) -> str:
    """Return the notice that some pads are too many to be compared unasked."""
    named = "name those that matter: qlvbayes compare OUT --pads A,B"
    return f"{head} are not all compared here; {named}"


def compare_pairs(out: Path, pads: Sequence[Saved], seed: int, watcher: Watcher) -> None:
    """Compare fluids where several specimens contain them, else every pair of a few pads."""
    pairs = fluid_pairs(pads) or pad_pairs(pads)
    if len(pairs) > _MOST_PAIRS:
        watcher.notice(not_all_compared(f"{len(pads)} pads make {len(pairs)} pairs, which"))
        return
    for first, second in pairs:
        CompareStep(seed=seed).run(out, first, second, watcher)


def draw_constants(out: Path, given: Path | None, data: Path | None = None) -> None:
    """Write the constants of all pads into ``out``: constants.csv, constants.tex and a figure.

    With the references that are given, which must all be usable, or those in the data's folder.
    """
    summaries = [summary.FitSummary.read(file) for file in sorted(out.glob("*/summary.json"))]
    nearby = data / REFERENCES if data is not None and (data / REFERENCES).is_file() else None
    file = given or nearby
    known: summary.References = summary.read_references(file) if file else {}
    if not given:
        known = summary.matching_references(known, summaries)
    entries, few = summary.constants_table(summaries, known), len(summaries) <= MOST_ON_A_PAGE
    summary.write_constants(out, entries, for_print=few)
    if few:
        from qlvbayes.plots.constants import plot_constants
        from qlvbayes.plots.files import save_figure

        label = f"reference ({file.name})" if file else "reference"
        save_figure(plot_constants(entries, reference=label), out / "constants")


def draw_forces_at_rates(out: Path) -> list[Path]:
    """Draw the figure forces_at_rates of two checked pads or more in one unit; return its path."""
    files = sorted(out.glob("*/curves.json"))
    if not 2 <= len(files) <= MOST_ON_A_PAGE:
        return []
    pads = [Curves.read(file) for file in files]
    if len({pad.units for pad in pads}) > 1:
        return []
    from qlvbayes.plots.files import save_figure
    from qlvbayes.plots.timeline import plot_forces_at_rates

    predictions: Any = {one.pad: [] for one in pads}
    for pad, test in ((one.pad, test) for one in pads for test in one.tests):
        rate = np.nan if test.rate is None else test.rate
        trial = SimpleNamespace(rate=rate, phases=test.phases)
        lines = ("time", "observed", "mean", "low", "high")  # what the figure needs of a prediction
        curves = {name: np.asarray(getattr(test, name)) for name in lines}
        predictions[pad].append(SimpleNamespace(trial=trial, **curves))
    return [save_figure(plot_forces_at_rates(predictions, pads[0].units), out / "forces_at_rates")]
