"""A verdict, and all that it rests on."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from qlvbayes.diagnosis.adequacy import Adequacy
from qlvbayes.diagnosis.design import Suggestion
from qlvbayes.diagnosis.remainder import Remainder
from qlvbayes.diagnosis.samples import CellError, Samples
from qlvbayes.diagnosis.search import Search, Weighed
from qlvbayes.diagnosis.sensitivity import Bend, Unseen
from qlvbayes.experiment import Experiment


@dataclass(frozen=True)
class Estimate:
    """A constant of an effect: Laplace mean and sd, with its unit."""

    unit: str
    mean: float
    sd: float

    def __str__(self) -> str:
        """``0.001672 +- 0.000090 N s/mm``: both to the sd's second digit, at most six decimals."""
        places = 1 - math.floor(math.log10(self.sd)) if self.sd > 0.0 else 3
        unit = "" if self.unit == "1" else f" {self.unit}"
        if places > 6:
            return f"{self.mean:.3g} +- {self.sd:.1g}{unit}"
        places = max(places, 0)
        return f"{self.mean:.{places}f} +- {self.sd:.{places}f}{unit}"


@dataclass(frozen=True)
class Ranked:
    """``none`` or an effect, over the whole posterior.

    inclusion: probability that it is in the model, of ``none`` that nothing is; probability: the
    same with that of every hypothesis shared out among its effects, so that all sum to one;
    log_bayes_factor: log posterior odds of being in less the log prior odds; rmse: of all samples
    (N) by the likeliest hypothesis with it; parameters: its constants there.
    """

    effect: str
    inclusion: float
    probability: float
    log_bayes_factor: float
    rmse: float
    parameters: dict[str, Estimate]


@dataclass(frozen=True)
class Base:
    """An elastic law and a relaxation by name, and their probability."""

    elastic: str
    relaxation: str
    probability: float

    def as_dict(self) -> dict:
        """For ``diagnosis.json``."""
        return {
            "elastic": self.elastic,
            "relaxation": self.relaxation,
            "probability": self.probability,
        }


@dataclass(frozen=True)
class Alternative:
    """A hypothesis and its probability: base laws and effects."""

    base: tuple[str, str]
    effects: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class Stage:
    """A hypothesis on the way to the verdict and what it leaves.

    rmse, heldout_rmse: over all samples (N), fitted and with each test left out in turn (nan where
    there is one test only); p_value: of the adequacy test; testable: whether the rests show if
    noise is correlated; cells: errors by test and phase; sound: whether the test is passed.
    """

    base: tuple[str, str]
    effects: tuple[str, ...]
    rmse: float
    heldout_rmse: float
    log_evidence: float
    p_value: float
    testable: bool
    sound: bool
    cells: tuple[CellError, ...]
    failing: tuple[tuple[str, str], ...]
    parameters: dict[str, Estimate]

    def other_laws(self, first: Stage) -> list[str]:
        """Base laws that an earlier stage has not."""
        return [law for law, own in zip(self.base, first.base, strict=True) if law != own]


@dataclass(frozen=True)
class NotRuledOut:
    """A set of effects that would explain the tests, and its probability over all base laws."""

    effects: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class Sampled:
    """One hypothesis, without a discrepancy: log evidence by Laplace, and by nested sampling."""

    effect: str
    laplace: float
    log_evidence: float
    error: float

    @property
    def agrees(self) -> bool:
        """Within three errors and half a unit."""
        return abs(self.laplace - self.log_evidence) < 3.0 * self.error + 0.5


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What one pad's tests say about the model.

    effects: what the verdict names, the group's likeliest last; group: effects of which one is
    there (``ambiguous``); base: the laws of the hypothesis told; bases: all, the likeliest first;
    stages: from the plain model that was chosen to the hypothesis told; ranking: inclusion
    probabilities; alternatives: the likeliest hypotheses; outside: probability that something
    outside the list is there; noise: the floor's sd (N), measured without the model; nested:
    evidence by nested sampling, where it was asked for; discrepancy: likeliest size (N) of what the
    hypothesis told leaves; forms: of effects that are told by another law than the list's, which
    (by the listed name); not_ruled_out: the likeliest sets of effects; constants: the base law's,
    averaged over all hypotheses on it; remainder: size of what the hypothesis told leaves; refused:
    effects that are likely, and why they are not named; notices: what one should know of the tests.
    """

    pad: str
    noise: float
    verdict: str
    effects: tuple[str, ...]
    group: tuple[str, ...]
    base: Base
    bases: tuple[Base, ...]
    stages: tuple[Stage, ...]
    ranking: tuple[Ranked, ...]
    alternatives: tuple[Alternative, ...]
    outside: float
    not_identifiable: tuple[Unseen, ...]
    bends: tuple[Bend, ...]
    coincident: tuple[tuple[str, ...], ...]
    refused: tuple[tuple[str, str], ...]
    suggestions: tuple[Suggestion, ...]
    work: Work
    nested: tuple[Sampled, ...] = ()
    discrepancy: float = 0.0
    forms: dict[str, str] = field(default_factory=dict)
    not_ruled_out: tuple[NotRuledOut, ...] = ()
    constants: dict[str, Estimate] = field(default_factory=dict)
    remainder: Remainder | None = None
    notices: tuple[str, ...] = ()

    @property
    def tried(self) -> tuple[str, ...]:
        """Effects of the hypothesis told."""
        return self.stages[-1].effects

    @property
    def warnings(self) -> tuple[str, ...]:
        """Where two ways to the evidence disagree."""
        return tuple(
            f"{s.effect}: log evidence {s.laplace:.1f} by Laplace, {s.log_evidence:.1f} +- "
            f"{s.error:.1f} by nested sampling"
            for s in self.nested
            if not s.agrees
        )

    @property
    def worst(self) -> CellError:
        """The cell in which the plain model fails worst."""
        return max(self.stages[0].cells, key=lambda cell: cell.rmse)

    def probability_of(self, effect: str) -> float:
        """That an effect is in the model; of ``none`` that none is."""
        return next((r.inclusion for r in self.ranking if r.effect == effect), 0.0)

    def as_dict(self) -> dict:
        """The content of ``diagnosis.json``."""
        worst = self.worst
        return {
            "schema": 1,
            "pad": self.pad,
            "units": self.work.experiment.units.as_dict(),
            "noise_N": self.noise,
            "verdict": self.verdict,
            "effects": list(self.effects),
            "group": list(self.group),
            "forms": dict(self.forms),
            "base": self.base.as_dict(),
            "bases": [base.as_dict() for base in self.bases],
            "outside": self.outside,
            "alternatives": [
                {
                    "base": {"elastic": one.base[0], "relaxation": one.base[1]},
                    "effects": list(one.effects),
                    "probability": one.probability,
                }
                for one in self.alternatives
            ],
            "not_ruled_out": [
                {"effects": list(one.effects), "probability": one.probability}
                for one in self.not_ruled_out
            ],
            "constants": _parameters(self.constants),
            "steps": [_stage(stage) for stage in self.stages],
            "ranking": [_ranked(ranked) for ranked in self.ranking],
            "not_identifiable": [
                {"effect": unseen.effect, "reason": unseen.reason}
                for unseen in self.not_identifiable
            ],
            "hidden_in_constants": [
                {
                    "effect": bend.effect,
                    "amplitude": bend.amplitude,
                    "size": bend.size,
                    "share_left": bend.left,
                    "changes": bend.changes,
                    "visible": bend.visible,
                }
                for bend in self.bends
            ],
            "coincident": [list(group) for group in self.coincident],
            "refused": [{"effect": name, "reason": why} for name, why in self.refused],
            "warnings": list(self.warnings),
            "notices": list(self.notices),
            "suggestions": [
                {"test": s.test, "expected_2_ln_bayes_factor": s.evidence} for s in self.suggestions
            ],
            "nested": [
                {
                    "effect": s.effect,
                    "log_evidence_laplace": s.laplace,
                    "log_evidence": s.log_evidence,
                    "error": s.error,
                    "agrees": s.agrees,
                }
                for s in self.nested
            ],
            "discrepancy_sd_N": self.discrepancy,
            "tolerance": self.remainder.tolerance if self.remainder else None,
            "remainder": self.remainder.as_dict() if self.remainder else None,
            "worst": {
                "test": worst.test,
                "phase": worst.phase,
                "rmse_N": worst.rmse,
                "bias_N": worst.bias,
            },
        }


@dataclass(frozen=True, eq=False)
class Work:
    """What a diagnosis was computed from, for figures and for what follows.

    path: the hypotheses of the stages, each at its likeliest mode.
    """

    experiment: Experiment
    search: Search
    samples: Samples
    path: tuple[Weighed, ...]
    adequacies: tuple[Adequacy, ...]

    @property
    def told(self) -> Weighed:
        """The hypothesis that stands for the answer."""
        return self.path[-1]


def _stage(stage: Stage) -> dict:
    return {
        "base": {"elastic": stage.base[0], "relaxation": stage.base[1]},
        "effects": list(stage.effects),
        "rmse_N": stage.rmse,
        "heldout_rmse_N": _finite(stage.heldout_rmse),
        "log_evidence": _finite(stage.log_evidence),
        "adequacy_p_value": stage.p_value,
        "noise_testable": stage.testable,
        "failing": [{"test": test, "phase": phase} for test, phase in stage.failing],
        "cells": [
            {
                "test": cell.test,
                "phase": cell.phase,
                "rate_mm_s": _finite(cell.rate),
                "n": cell.n,
                "rmse_N": cell.rmse,
                "bias_N": cell.bias,
            }
            for cell in stage.cells
        ],
        "parameters": _parameters(stage.parameters),
    }


def _ranked(ranked: Ranked) -> dict:
    return {
        "effect": ranked.effect,
        "inclusion": ranked.inclusion,
        "probability": ranked.probability,
        "log_bayes_factor": _finite(ranked.log_bayes_factor),
        "rmse_N": ranked.rmse,
        "parameters": _parameters(ranked.parameters),
    }


def _parameters(found: dict[str, Estimate]) -> dict:
    return {name: {"unit": e.unit, "mean": e.mean, "sd": e.sd} for name, e in found.items()}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
