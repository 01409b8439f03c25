"""All steps of a study, from its measurements to the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.settings import Settings as Thresholds
from qlvbayes.diagnosis.telling.verdict import Diagnosis
from qlvbayes.fitting.checked import CheckedPad
from qlvbayes.fitting.ensemble import Settings
from qlvbayes.fitting.results import Saved, load
from qlvbayes.fitting.runs import record_run
from qlvbayes.io.data import Measurements, Pad, read_measurements
from qlvbayes.io.files import write_whole
from qlvbayes.laws.catalogue import find_elastic, find_relaxation
from qlvbayes.model.choices import Choices
from qlvbayes.pipeline.checking import check_into
from qlvbayes.pipeline.comparing import compare_into, fluid_pairs, pad_pairs
from qlvbayes.pipeline.diagnosing import diagnose_into
from qlvbayes.pipeline.drawing import draw_constants, draw_forces_at_rates, references_of
from qlvbayes.pipeline.fitting import fit_into
from qlvbayes.pipeline.looking import look_into
from qlvbayes.pipeline.watcher import Watcher
from qlvbayes.report.page import write_report

_MOST_PAIRS = 6  # compared unasked


def run_study(
    file: str | Path | Measurements,
    out: str | Path,
    *,
    pads: Sequence[str] = (),
    choices: Choices | None = None,
    settings: Settings | None = None,
    thresholds: Thresholds | None = None,
    watcher: Watcher | None = None,
    command: str = "",
    references: str | Path | None = None,
) -> list[Diagnosis]:
    """Do everything for the named pads (all by default); return their verdicts.

    Leaves in ``out``: the first look at the tests, before anything is fitted (``look.json``,
    ``look_<pad>.png``); per pad the plain model's fit and check in ``<pad>/plain``, the diagnosis
    and, with the laws and effects that it names, the fit and its check in ``<pad>``: to all tests
    of all pads where something new is named in one, so that comparing them is fair; else they are
    those of the plain model. Comparisons of the pads, or of the fluids in
    them, in ``compare``; constants (PNG, PDF, CSV, LaTeX) and, for two pads or more,
    forces_at_rates of all; ``run.json`` and ``report.html``.

    Parameters
    ----------
    file
        Measurements, or the file of them.
    out
        The folder of results.
    pads
        Names of the pads.
    choices
        The model to start from, by default the plain one, bonded where the file holds strain and
        stress.
    settings
        Of the sampler.
    thresholds
        Of the diagnosis, its ``tolerance`` among them.
    watcher
        Is told of each step.
    command
        Noted as what repeats the study.
    references
        A CSV file (pad,parameter,value,unit) of values to show beside the constants, by default
        paper_table1.csv beside the measurements, if it is there.

    Raises
    ------
    InputError
        Measurements, choices or references cannot be used.
    """
    study = file if isinstance(file, Measurements) else read_measurements(file)
    out, watcher, settings = Path(out), watcher or Watcher(), settings or Settings()
    thresholds = thresholds or Thresholds()
    choices = choices or Choices(bonded=study.units.bonded_default)
    wanted = [study.pad(name) for name in pads] or list(study.pads)
    known = references_of(study, None if references is None else Path(references))
    with watcher.doing("looking"):
        look, figures = look_into(
            out, study, wanted, bonded=choices.bonded, effects=choices.effects,
            keep_all_readings=choices.keep_all_readings,
        )  # fmt: skip
    watcher.looked(look, figures)
    steps = _Steps(study, out, choices, settings, thresholds, watcher)
    first = [steps.plain(pad) for pad in wanted]
    new = any(told.choices != choices for told in first)
    pairs = zip(wanted, first, strict=True)
    done = [steps.final(pad, told, all_tests=new) for pad, told in pairs]
    with watcher.doing("figures of all pads"):
        draw_constants(out, known)
        draw_forces_at_rates(out, done)
    _compare([load(out / pad.name / "posterior.nc") for pad in wanted], out, settings, watcher)
    call = command or _call(study, out)
    told = {"sampler": settings, "thresholds": thresholds}
    record_run(out, "study", call, study, choices, settings.seed, told)
    with watcher.doing("report"):
        write_report(out)
    return [told.found for told in first]


def _compare(pads: list[Saved], out: Path, settings: Settings, watcher: Watcher) -> None:
    """Fluids where there are specimens of them, else every pair of a few pads."""
    pairs = fluid_pairs(pads) or pad_pairs(pads)
    if len(pairs) > _MOST_PAIRS:
        watcher.notice(
            f"{len(pads)} pads make {len(pairs)} pairs, which are not all compared here; "
            "name those that matter: qlvbayes compare OUT --pads A,B"
        )
        return
    for first, second in pairs:
        compare_into(out, first, second, seed=settings.seed, watcher=watcher)


def _call(study: Measurements, out: Path) -> str:
    return f"qlvbayes.run_study({Path(study.source).name!r}, {out.name!r}, ...)"


@dataclass(frozen=True, eq=False)
class _Told:
    """A pad's diagnosis, the check of its plain fit, and the choices that the verdict makes."""

    found: Diagnosis
    plain: CheckedPad
    choices: Choices


@dataclass(frozen=True, eq=False)
class _Steps:
    """What is done with each pad, into a folder of its own."""

    study: Measurements
    out: Path
    choices: Choices
    settings: Settings
    thresholds: Thresholds
    watcher: Watcher

    def plain(self, pad: Pad) -> _Told:
        """The plain model's fit and check, and the diagnosis."""
        folder, choices = self.out / pad.name, self.choices
        checked = self._fit_and_check(pad, choices, folder / "plain", all_tests=False)
        found = diagnose_into(
            folder,
            pad,
            choices,
            evidence="laplace",
            seed=self.settings.seed,
            watcher=self.watcher,
            thresholds=self.thresholds,
        )
        told = found.result
        new = (told.forms.get(name, name) for name in told.effects if name not in choices.effects)
        fuller = replace(_on_laws(choices, told), effects=(*choices.effects, *new))
        return _Told(found, checked, fuller)

    def final(self, pad: Pad, told: _Told, *, all_tests: bool) -> CheckedPad:
        """What the verdict names: the same tests of every pad, so that comparing them is fair."""
        folder = self.out / pad.name
        if told.choices == self.choices and not all_tests:
            for file in filter(Path.is_file, (folder / "plain").iterdir()):
                write_whole(folder / file.name, file.read_bytes())
            return told.plain
        return self._fit_and_check(pad, told.choices, folder, all_tests=all_tests)

    def _fit_and_check(
        self, pad: Pad, choices: Choices, folder: Path, *, all_tests: bool
    ) -> CheckedPad:
        study, settings, watcher = self.study, self.settings, self.watcher
        fit_into(
            folder,
            pad,
            study,
            choices,
            method="emcee",
            all_tests=all_tests,
            settings=settings,
            watcher=watcher,
        )
        saved = load(folder / "posterior.nc")
        return check_into(folder, saved, study, seed=settings.seed, watcher=watcher)[0]


def _on_laws(choices: Choices, found: DiagnosisResult) -> Choices:
    """With the base laws that the verdict stands on, if it has any; a Prony series keeps its modes.

    What the user said of the constants of a law goes with it.
    """
    if found.verdict == "unexplained":
        return choices
    elastic, relaxation = found.base.elastic, found.base.relaxation.partition(":")[0]
    gone: set[str] = set()
    if elastic != choices.law:
        gone.update(find_elastic(choices.law, choices.laws).units)
    if relaxation != choices.relaxation:
        gone.update(find_relaxation(choices.relaxation, choices.laws).units)

    def kept(settings: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(text for text in settings if _constant(text) not in gone)

    priors, fixed = kept(choices.priors), kept(choices.fixed)
    return replace(choices, law=elastic, relaxation=relaxation, priors=priors, fixed=fixed)


def _constant(setting: str) -> str:
    """The constant's name in ``v[2]=0.14``, without its number."""
    return setting.partition("=")[0].partition("[")[0].strip()
