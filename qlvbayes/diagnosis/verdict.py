"""One of four verdicts, and all that it rests on."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from qlvbayes.diagnosis.adequacy import Adequacy
from qlvbayes.diagnosis.design import Suggestion
from qlvbayes.diagnosis.forms.otherform import Shape
from qlvbayes.diagnosis.gate import Bend, Unseen
from qlvbayes.diagnosis.remainder import Remainder
from qlvbayes.diagnosis.samples import CellError, Samples
from qlvbayes.diagnosis.search import Path
from qlvbayes.experiment import Experiment
from qlvbayes.inference.subset import Ensemble

VERDICTS = ("adequate", "missing_effect", "ambiguous", "unexplained")


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
    """One hypothesis of the first round: ``none`` or an effect.

    probability: that it is what the plain model lacks, if one of the list is; rmse: of all samples
    (N), None where the screen settled it without a refit.
    """

    effect: str
    probability: float
    log_bayes_factor: float
    rmse: float | None
    parameters: dict[str, Estimate]


@dataclass(frozen=True)
class Stage:
    """A model on the way to the verdict and what it leaves.

    rmse, heldout_rmse: over all samples (N), fitted and with each test left out in turn; p_value:
    of the adequacy test; testable: whether the rests show if noise is correlated; cells: errors by
    test and phase; sound: whether the test is passed; shape: of the effect that has another form
    than the list's.
    """

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
    shape: Shape | None = None

    @property
    def labels(self) -> tuple[str, ...]:
        """The effects, one of another form marked."""
        other = self.shape.effect if self.shape else None
        return tuple(f"{e} (other form)" if e == other else e for e in self.effects)


@dataclass(frozen=True)
class NotRuledOut:
    """A set of effects that would explain the tests, and its probability among all such.

    What the probabilities of all that are told lack of one is that of explanations less likely.
    """

    effects: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class Sampled:
    """One hypothesis of the first round: log evidence by Laplace, and by nested sampling."""

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

    effects: what the verdict names, in the order added; group: effects that explain the data
    equally well (``ambiguous``); tried: what was added on the way, also where the verdict is
    ``unexplained``; noise: the floor's sd (N), measured without the model; nested: evidence by
    nested sampling, where it was asked for; discrepancy: typical size (N) of the Gaussian-process
    discrepancy where structure is left; unlisted: log Bayes factors of rivals that no list holds
    against the last model, by name; outside: the one that clearly beats it, if any; not_ruled_out:
    the likeliest explanations within the window of the one named, or of the likeliest if none is,
    none where the verdict is ``unexplained``; constants: the plain model's, averaged over all
    explanations in the window, or by the last model if there are none; remainder: size of what the
    last model leaves; notices: what one should know of the tests.
    """

    pad: str
    noise: float
    verdict: str
    effects: tuple[str, ...]
    group: tuple[str, ...]
    stages: tuple[Stage, ...]
    ranking: tuple[Ranked, ...]
    not_identifiable: tuple[Unseen, ...]
    bends: tuple[Bend, ...]
    coincident: tuple[tuple[str, ...], ...]
    refused: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...]
    suggestions: tuple[Suggestion, ...]
    work: Work
    nested: tuple[Sampled, ...] = ()
    discrepancy: float | None = None
    unlisted: dict[str, float] = field(default_factory=dict)
    outside: str | None = None
    not_ruled_out: tuple[NotRuledOut, ...] = ()
    constants: dict[str, Estimate] = field(default_factory=dict)
    remainder: Remainder | None = None
    notices: tuple[str, ...] = ()

    @property
    def tried(self) -> tuple[str, ...]:
        """Effects of the last model."""
        return self.stages[-1].effects

    @property
    def own_form(self) -> Ranked | None:
        """The one effect named where it has another form than the list's, which the ranking lacks.

        Its log Bayes factor is against the plain model. No probability (nan): a form is not one of
        the hypotheses that share it.
        """
        first, last = self.stages[0], self.stages[-1]
        if last.shape is None or len(last.effects) != 1:
            return None
        name, gain = last.shape.effect, last.log_evidence - first.log_evidence
        own = {
            key.removeprefix(f"{name}."): value
            for key, value in last.parameters.items()
            if key.startswith(f"{name}.")
        }
        return Ranked(name, math.nan, gain, last.rmse, own)

    @property
    def worst(self) -> CellError:
        """The cell in which the plain model fails worst."""
        return max(self.stages[0].cells, key=lambda cell: cell.rmse)

    @property
    def probability(self) -> float:
        """Of the first round's best hypothesis."""
        return max(ranked.probability for ranked in self.ranking)

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
            "unlisted": [
                {"rival": name, "log_bayes_factor": _finite(value)}
                for name, value in self.unlisted.items()
            ],
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
    """What a diagnosis was computed from, for figures and for what follows."""

    experiment: Experiment
    ensemble: Ensemble
    samples: Samples
    path: Path
    adequacies: tuple[Adequacy, ...]


def _stage(stage: Stage) -> dict:
    return {
        "effects": list(stage.effects),
        "rmse_N": stage.rmse,
        "heldout_rmse_N": stage.heldout_rmse,
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
        "other_form": _shape(stage.shape) if stage.shape else None,
    }


def _shape(shape: Shape) -> dict:
    return {
        "effect": shape.effect,
        "over_depth": [{"depth": x, "factor": y} for x, y in shape.over_depth],
        "over_clock": [{"clock_s": x, "factor": y} for x, y in shape.over_clock],
        "over_force": [{"force_N": x, "factor": y} for x, y in shape.over_force],
        "over_pressure": [{"pressure_N": x, "factor": y} for x, y in shape.over_pressure],
        "over_delay": [{"delay_s": x, "weight": y} for x, y in shape.over_delay],
    }


def _ranked(ranked: Ranked) -> dict:
    return {
        "effect": ranked.effect,
        "probability": ranked.probability,
        "log_bayes_factor": _finite(ranked.log_bayes_factor),
        "rmse_N": ranked.rmse,
        "parameters": _parameters(ranked.parameters),
    }


def _parameters(found: dict[str, Estimate]) -> dict:
    return {name: {"unit": e.unit, "mean": e.mean, "sd": e.sd} for name, e in found.items()}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
