"""The step that compares two pads or two fluids of a folder of results, and what is compared."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import ClassVar

from qlvbayes.comparison.compare import REGION, compare
from qlvbayes.comparison.contrast import Comparison
from qlvbayes.comparison.writing import write_comparison
from qlvbayes.fitting.results import Saved, load
from qlvbayes.io.checks import InputError
from qlvbayes.io.data import Measurements, read_measurements
from qlvbayes.motion.facts import covered
from qlvbayes.parallel.running import package_digest
from qlvbayes.pipeline.finished import FITTED, digest_of, is_finished, record_finished
from qlvbayes.pipeline.watcher import Watcher
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

    name: ClassVar[str] = "compare"
    needs: ClassVar[tuple[str, ...]] = ("posterior.nc",)  # of each pad
    leaves: ClassVar[tuple[str, ...]] = tuple(f"compare.{kind}" for kind in ("json", "csv", "txt"))
    code: ClassVar[tuple[str, ...]] = (*FITTED, "comparison")

    region: float = REGION
    depth: float | None = None
    rates: tuple[float, ...] | None = None
    frequencies: tuple[float, ...] | None = None
    seed: int = 0

    def run(self, out: Path, first: Group, second: Group, watcher: Watcher) -> Comparison:
        """Compare the groups in ``out/compare``; one that is finished is read."""
        names = first[0], second[0]
        folder = out / FOLDER / f"{names[0]}-vs-{names[1]}"
        key = self._key(first, second)
        if is_finished(out, self.name, folder.name, key, folder):
            return Comparison.read(folder / self.leaves[0])
        with watcher.doing(f"comparing {names[0]} with {names[1]}"):
            comparison = compare(
                first[1], second[1], names=names, region=self.region, depth=self.depth,
                rates=self.rates, frequencies=self.frequencies, seed=self.seed,
            )  # fmt: skip
            files = [*write_comparison(folder, comparison), _figure(comparison, folder)]
        record_finished(out, self.name, folder.name, key, {f.name: digest_of(f) for f in files})
        return comparison

    def _key(self, first: Group, second: Group) -> str:
        draws = [
            (saved.pad, saved.fluid, saved.draws.tobytes()) for saved in (*first[1], *second[1])
        ]
        digests = [(pad, fluid, hashlib.sha256(x).hexdigest()) for pad, fluid, x in draws]
        parts = (self, first[0], second[0], digests, package_digest(self.code))
        return hashlib.sha256(repr(parts).encode()).hexdigest()


def figure_of(out: Path, comparison: Comparison) -> Path:
    """Return the path of a comparison's figure."""
    return out / FOLDER / "-vs-".join(comparison.names) / "contrasts.png"


def _figure(comparison: Comparison, folder: Path) -> Path:
    # imported here, so that the other steps do not wait for matplotlib
    from qlvbayes.plots.contrasts import plot_contrasts
    from qlvbayes.plots.files import save_figure

    return save_figure(plot_contrasts(comparison), folder / "contrasts")


def saved_pads(out: Path, data: Path | None = None, *, only: Sequence[str] = ()) -> list[Saved]:
    """Return the fits of named pads in a folder, by default all; InputError if there are none."""
    names = only or fitted_pads(out)  # of many pads no others are read
    files = [out / name / "posterior.nc" for name in names]
    studies: dict[Path, Measurements] = {}
    return [_with_coverage(load(file), data, studies) for file in files]


def _with_coverage(saved: Saved, data: Path | None, studies: dict[Path, Measurements]) -> Saved:
    source = data or Path(saved.source)
    if saved.covered is not None or not source.is_file():
        return saved
    if source not in studies:
        studies[source] = read_measurements(source)
    pad = studies[source].pad(saved.pad)
    experiment = saved.choices.prepare(pad)
    return replace(saved, covered=covered(experiment), fluid=saved.fluid or pad.fluid)


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


def compare_few(out: Path, pads: Sequence[str], seed: int, watcher: Watcher) -> None:
    """Compare the fluids of some fitted pads, or where there are none every pair of a few pads."""
    if len(pads) > MOST_ON_A_PAGE:
        _leave_out(f"{len(pads)} pads", watcher)
    else:
        compare_pairs(out, [load(out / pad / "posterior.nc") for pad in pads], seed, watcher)


def compare_pairs(out: Path, pads: Sequence[Saved], seed: int, watcher: Watcher) -> None:
    """Compare fluids where several specimens contain them, else every pair of a few pads."""
    pairs = fluid_pairs(pads) or pad_pairs(pads)
    if len(pairs) > _MOST_PAIRS:
        _leave_out(f"{len(pads)} pads make {len(pairs)} pairs, which", watcher)
        return
    for first, second in pairs:
        CompareStep(seed=seed).run(out, first, second, watcher)


def _leave_out(what: str, watcher: Watcher) -> None:
    watcher.notice(
        f"{what} are not all compared here; name those that matter: qlvbayes compare OUT --pads A,B"
    )
