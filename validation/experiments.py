r"""Three experiments on the kept modes of finished searches: would another evidence decide better?

Studies of a published run are searched again as ever, and the modes of all hypotheses within 20
nats of the best are evaluated once more.

1. *Weight of the signatures.* The discrepancy holds the response of every candidate effect beside
   its smooth functions. Their size is 1, 0.3 or 0 times that of these; or none of them is there, or
   exactly one, each with a probability of 5 %.
2. *A joint sparse choice.* At the best laws without effects every effect's response at several
   shapes is a column x with a strength of one prior sd, beside the discrepancy. Sets S of up to
   five are compared by :math:`\tfrac12 g_S^T (C_S + 1)^{-1} g_S - \tfrac12 \ln |C_S + 1|` plus
   their log prior odds, with gradient g and curvature C of minus the log density over strengths,
   the constants following. The best three sets are evaluated as hypotheses.
3. *Three states.* An effect of a hypothesis is present, with one strength, or mimicked: its
   strength deviates in each test by a factor of N(0, 1), and it names nothing. Both are equally
   probable before the tests, and absence is as before.

Each answers by probabilities alone (`decision.decide`): no support, no certainty. Counted are right
and wrong verdicts, and the log loss of each effect's probability. ``--studies N -o OUT`` writes a
study a line, from which an interrupted run goes on; ``--keep`` keeps the table.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from blind.counting import Case, has_failed, is_right, names_wrongly, true_names
from blind.store import Store, run_missing
from blind.study import make_study
from guess_pads import soonest
from lifelike import commit
from numpy.typing import NDArray
from registration import Registration
from results import Origin, Table, commits_of, share
from runs import read_cases
from scipy.linalg import null_space
from scipy.special import logsumexp

from qlvbayes.cli.console import counting
from qlvbayes.diagnosis.candidate import Candidate, candidate_at
from qlvbayes.diagnosis.decision import Weight, decide
from qlvbayes.diagnosis.diagnose import run_search
from qlvbayes.diagnosis.prior import log_odds_of_effect
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.inference.density import Density
from qlvbayes.inference.errors.scatter import by_test
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.modes import find_mode
from qlvbayes.inference.starts import shapes, without
from qlvbayes.io.runtime import one_blas_thread
from qlvbayes.motion.experiment import prepare
from qlvbayes.parallel.engines import opened_engine

Array = NDArray[np.float64]

RUN = "support"
_WITHIN = 20.0  # nats behind the best hypothesis, within which others are evaluated again
_WEIGHTS = (1.0, 0.3, 0.0)
_ALONE = 0.05  # probability of each signature, where at most one is there
_BEAM, _MOST, _SETS = 10, 5, 3  # sets that are kept while they grow, effects of one, those tried
_MIMICKED = 0.5  # probability that something else mimics an effect that a hypothesis has
_NEW = 0.5  # log posterior by which a proposed set must beat what the search found


def run_case(cases: Sequence[Case], commit: str, index: int) -> Case:
    """Search one study of the run, and answer by every variant of the evidence."""
    begun = time.process_time()
    published = next(case for case in cases if case["index"] == index)
    study = make_study(Registration.read(RUN).population, index)
    search = build_search(prepare(study.pad))
    smooth = len(search.density.discrepancy.features)
    with one_blas_thread():
        run_search(search)
        searched = time.process_time()
        signatures = len(search.density.discrepancy.features) - smooth
        known = {
            f"signatures times {weight:g}": again(
                search, weighted(search.density, signatures, weight)
            )
            for weight in _WEIGHTS
        }
        known["at most one signature"] = one_at_most(search, signatures)
        answers = {name: answer(published, one, one.weights()) for name, one in known.items()}
        answers["three states"] = answer(published, search, three_states(search))
        answers["as searched"] = answer(published, search, search.weights())
        found = proposals(search)
        answers["sets proposed"] = answer(published, search, search.weights())
    kept = {key: published[key] for key in ("kind", "names", "kin", "rig", "strata", "seen")}
    return kept | {
        "plan": "experiments", "index": index, "commit": commit, "verdict": "", "answers": answers,
        "proposals": found, "seconds": [searched - begun, time.process_time() - searched],
    }  # fmt: skip


def answer(published: Case, search: Search, weights: Sequence[Weight]) -> Case:
    """Return the verdict by probabilities alone, and whether it is right."""
    decision = decide(weights, search.settings)
    relaxation = weights[decision.selected].base[1]
    case = published | {
        "verdict": str(decision.verdict), "effects": list(decision.effects),
        "group": list(decision.group), "base": {"relaxation": relaxation},
    }  # fmt: skip
    there = true_names(case)
    # what is there though it was not hidden is neither wanted nor wrong
    anyway = true_names(case | {"names": [], "kin": {}, "kind": "none"})
    free = set(search.families.nameable) - (anyway - set(case["names"]))
    stated = {name: decision.inclusion.get(name, 0.0) for name in free}
    p = np.clip(list(stated.values()), 1e-3, 1.0 - 1e-3)
    y = np.array([float(name in there) for name in stated])
    loss = float(-np.mean(y * np.log(p) + (1.0 - y) * np.log1p(-p)))
    sure = [name for name, value in stated.items() if value >= search.settings.named]
    return {
        "verdict": case["verdict"], "effects": case["effects"], "group": case["group"],
        "right": is_right(case), "wrong": names_wrongly(case), "loss": loss,
        "sure": [len(sure), sum(name in there for name in sure)],
    }  # fmt: skip


def weighted(density: Density, signatures: int, weight: float) -> Density:
    """Return the density whose last features, the signatures, are of another size."""
    features = density.discrepancy.features.copy()
    features[len(features) - signatures :] *= weight
    features = features if weight else features[: len(features) - signatures]
    return Density(density.space, replace(density.discrepancy, features=features, _by_size={}))


def again(search: Search, density: Density) -> Search:
    """Return a search with its likely hypotheses at their modes under another density."""
    best, modes = search.log_posterior(search.best), {}
    for hypothesis, known in search.modes.items():
        if search.log_posterior(hypothesis) < best - _WITHIN:
            continue
        found = [
            candidate_at(density, hypothesis, mode, search.settings.tolerance)
            for one in known
            if (mode := find_mode(density, hypothesis, one.point.theta, guess=one.mode.size))
        ]
        found.sort(key=lambda one: -one.log_evidence)
        if found:
            modes[hypothesis] = found
    return replace(search, density=density, modes=modes)


def one_at_most(search: Search, signatures: int) -> Search:
    """Return a search in which none of the signatures is there, or exactly one."""
    smooth = again(search, weighted(search.density, signatures, 0.0))
    discrepancy, tolerance = search.density.discrepancy, search.settings.tolerance
    first = len(discrepancy.features) - signatures
    by_size = {one: [own[0].evidence.by_size] for one, own in smooth.modes.items()}
    for k in range(first, first + signatures):
        features = np.concatenate([discrepancy.features[:first], discrepancy.features[k : k + 1]])
        density = Density(
            search.density.space, replace(discrepancy, features=features, _by_size={})
        )
        for hypothesis, (own, *_) in smooth.modes.items():
            point = density.at(hypothesis, own.point.theta)
            if point is not None:
                mode = replace(own.mode, point=point)
                new = candidate_at(density, hypothesis, mode, tolerance)
                by_size[hypothesis].append(new.evidence.by_size)
    shares = np.log([1.0 - signatures * _ALONE / (1.0 + signatures * _ALONE)])
    for hypothesis, own in smooth.modes.items():
        parts = np.array(by_size[hypothesis])
        one = shares[0] + np.log(_ALONE)
        logs = np.concatenate([[shares[0]], np.full(len(parts) - 1, one)])
        mixed = np.asarray(logsumexp(parts + logs[:, None], axis=0))
        total = float(logsumexp(mixed))
        change = total - own[0].evidence.log
        evidence = replace(own[0].evidence, by_size=mixed, log=total)
        own[0] = replace(own[0], evidence=evidence, log_evidence=own[0].log_evidence + change)
    return smooth


def three_states(search: Search) -> list[Weight]:
    """Return a weight for each hypothesis with each of its effects present or mimicked."""
    best, found = search.log_posterior(search.best), []
    for weight, own in zip(search.weights(), search.candidates.values(), strict=True):
        gains = dict[str, float]()
        if weight.log_posterior > best - _WITHIN:
            for name in search.added(own.hypothesis):
                gains[search.families.family_of[name]] = mimicry(search.density, own, name)
        for states in product((False, True), repeat=len(gains)):
            gone = {name for name, state in zip(gains, states, strict=True) if state}
            log = weight.log_posterior + sum(gains[name] for name in gone)
            log += len(gone) * np.log(_MIMICKED) + (len(gains) - len(gone)) * np.log1p(-_MIMICKED)
            left = replace(weight, effects=weight.effects - gone, log_posterior=log)
            found.append(replace(left, unmodelled=1.0) if gone else left)
    return found


def mimicry(density: Density, candidate: Candidate, effect: str) -> float:
    """Return the log Bayes factor of a strength of its own in each test, over one strength."""
    point, space = candidate.point, density.space
    rest = space.forces(*without(space, point, effect))[0]
    parts = by_test(np.where(space.real, point.predicted - rest, 0.0)[None])
    parts = parts[np.any(parts != 0.0, axis=(1, 2))]
    if len(parts) < 2:
        return 0.0
    sized = density.discrepancy.at(candidate.mode.size, point.separation)
    terms = point.added_terms(density.whitener(parts), sized)
    apart = null_space(np.sum(parts**2, axis=(1, 2))[None])
    inner, along = apart.T @ terms.curvature @ apart, apart.T @ terms.gradient
    point.separation.forget()
    return _gain(inner, along)


def _gain(curvature: Array, gradient: Array) -> float:
    """Return the log Bayes factor of strengths of N(0, 1) over none."""
    inner = curvature + np.eye(len(gradient))
    fit = 0.5 * float(gradient @ np.linalg.solve(inner, gradient))
    return fit - 0.5 * float(np.linalg.slogdet(inner)[1])


def proposals(search: Search) -> dict:
    """Evaluate the sets that the joint choice proposes; return them with the log posteriors."""
    best = search.best
    before = search.log_posterior(best)
    plain = replace(best, effects=search.baseline.effects)
    search.evaluate(plain)
    if plain not in search.modes:
        return {"before": before, "after": before, "sets": []}
    names, columns = responses(search, plain)
    some = [
        (sorted(names[k] for k in chosen)) for chosen in chosen_sets(search, plain, columns, names)
    ]
    tried = []
    for effects in some:
        hypothesis = replace(plain, effects=plain.effects | set(effects))
        known = hypothesis in search.modes
        search.evaluate(hypothesis, plain)
        tried.append([effects, known, search.log_posterior(hypothesis)])
    return {"before": before, "after": search.log_posterior(search.best), "sets": tried}


def responses(search: Search, plain: Hypothesis) -> tuple[list[str], Array]:
    """Return the whitened forces (C, n) of one prior sd of every effect, and its name for each."""
    space, point = search.density.space, search.modes[plain][0].point
    names, columns = [], []
    for name in search.families.nameable:
        if name not in search.families.addable(plain.effects):
            continue
        own = space.parameters(plain.plus(name))
        amplitude = own.amplitude_of.get(name)
        if amplitude is None:
            continue
        none = np.stack(shapes(space, point, own, name))
        added = space.added_forces(own.hypothesis, none, amplitude.number, amplitude.sd)
        sound = np.isfinite(added).all(axis=(1, 2)) & np.any(added != 0.0, axis=(1, 2))
        columns.append(search.density.whitener(added[sound]))
        names += [name] * int(sound.sum())
    return names, np.concatenate(columns)


def chosen_sets(
    search: Search, plain: Hypothesis, columns: Array, names: Sequence[str]
) -> list[tuple[int, ...]]:
    """Return the columns of the most probable sets, the sizes of the discrepancy summed over."""
    density, (own, *_) = search.density, search.modes[plain]
    odds = log_odds_of_effect(len(search.families.nameable), search.settings)
    which = np.array(names)
    total: dict[frozenset[str], tuple[float, tuple[int, ...]]] = {}
    for k, size in enumerate(density.discrepancy.sizes.tolist()):
        terms = own.point.added_terms(columns, density.discrepancy.at(size, own.point.separation))
        start = float(density.discrepancy.log_prior[k]) - terms.loss
        beam: list[tuple[float, tuple[int, ...]]] = [(start, ())]
        for _ in range(_MOST):
            grown = dict[frozenset[str], tuple[float, tuple[int, ...]]]()
            for log, chosen in beam:
                gains = _one_more(terms.curvature, terms.gradient, list(chosen)) + odds
                gains[np.isin(which, which[list(chosen)])] = -np.inf
                for j in np.argsort(gains)[::-1][: 3 * _BEAM].tolist():
                    key = frozenset(which[[*chosen, j]].tolist())
                    if log + gains[j] > grown.get(key, (-np.inf,))[0]:
                        grown[key] = log + float(gains[j]), (*chosen, j)
            beam = sorted(grown.values(), reverse=True)[:_BEAM]
            for log, chosen in beam:
                key = frozenset(which[list(chosen)].tolist())
                known = total.get(key, (-np.inf, chosen))
                total[key] = float(np.logaddexp(known[0], log)), known[1]
    own.point.separation.forget()
    return [chosen for _, chosen in sorted(total.values(), reverse=True)[:_SETS]]


def _one_more(curvature: Array, gradient: Array, chosen: list[int]) -> Array:
    """Return the gain (C,) of each column beside those that are chosen."""
    widths, along = np.diag(curvature) + 1.0, gradient
    if chosen:
        inner = curvature[np.ix_(chosen, chosen)] + np.eye(len(chosen))
        mixed = np.linalg.solve(inner, curvature[chosen])
        widths = widths - np.einsum("cn,cn->n", curvature[chosen], mixed)
        along = along - gradient[chosen] @ mixed
    widths = np.maximum(widths, 1.0)
    return np.asarray(0.5 * along**2 / widths - 0.5 * np.log(widths))


VARIANTS = (
    "as searched", "signatures times 1", "signatures times 0.3", "signatures times 0",
    "at most one signature", "sets proposed", "three states",
)  # fmt: skip


def keep(cases: Sequence[Case], count: int) -> None:
    """Write validation/results/experiments.json."""
    rows = []
    for name in VARIANTS:
        own = [case["answers"][name] for case in cases]
        there, sure = sum(one["sure"][1] for one in own), sum(one["sure"][0] for one in own)
        loss = np.array([one["loss"] for one in own])
        apart = loss - np.array([case["answers"]["as searched"]["loss"] for case in cases])
        error = float(apart.std(ddof=1) / np.sqrt(len(apart)))
        rows.append(
            [
                name, share(sum(one["right"] for one in own), len(own)),
                share(sum(one["wrong"] for one in own), len(own)), share(there, sure),
                f"{loss.mean():.3f}", f"{apart.mean():+.3f} ± {error:.3f}",
            ]
        )  # fmt: skip
    better = [
        case for case in cases if case["proposals"]["after"] > case["proposals"]["before"] + _NEW
    ]
    large = [case for case in cases if any(len(one[0]) > 3 for one in case["proposals"]["sets"])]
    seconds = np.mean([case["seconds"] for case in cases], axis=0)
    notes = [
        f"{len(cases)} of {count} registered studies were finished; {seconds[0]:.0f} s of CPU each "
        f"for simulation and search, {seconds[1]:.0f} s for what is compared.",
        f"A proposed set, or what it led to, is more probable than all that the search found in "
        f"{share(len(better), len(cases))}; sets of four or five effects are proposed in "
        f"{share(len(large), len(cases))}.",
    ]
    machine = f"{os.cpu_count()} cores ({platform.machine()}), Python {platform.python_version()}"
    command = f"python validation/experiments.py --studies {count}"
    origin = Origin(command, Origin.today(), commits_of(cases), machine)
    Table(origin, len(cases), COLUMNS, rows, notes).write("experiments")


COLUMNS = [
    "evidence", "right by kind", "wrong names", "there, of a probability of 0.9 or more",
    "log loss an effect", "change",
]  # fmt: skip


def main() -> int:
    """Run, or keep the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=36)
    parser.add_argument("--jobs", type=int, default=1, help="processes that run the studies")
    parser.add_argument("--keep", action="store_true", help="keep the table of what is finished")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args()
    cases = [case for case in soonest(read_cases(RUN)) if case["seen"] and not has_failed(case)]
    cases = cases[: options.studies]
    indices = [case["index"] for case in cases]
    store = Store(options.output / "experiments.jsonl", "experiments")
    if not options.keep:
        run: Callable[[int], Case] = partial(run_case, cases, commit())
        with opened_engine(options.jobs) as engine, counting("studies") as done:
            run_missing(run, store, indices, done, engine)
    keep([store.cases[index] for index in indices if index in store.cases], options.studies)
    return 0


if __name__ == "__main__":
    sys.exit(main())
