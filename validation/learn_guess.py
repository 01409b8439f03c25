"""Learn the first guess from simulated pads, and count what it is worth on pads left out.

`learn_guess.py --pads N --seed S -o FILE.json` simulates the first N pads of `guess_pads`, learns
the weights of `qlvbayes/guess/guess.py` and writes them. Then each pad is guessed by what the other
four fifths teach, and once more by what the pads of other programmes teach; with `--keep NAME`
these counts become validation/results/guess.json. N, S and the rules of the count are registered in
validation/registered/NAME.json before: pads with which the features were chosen are learnt from,
and not counted.

What is asked of an effect is whether it, or a form of it, is hidden where the tests could show it.
Not asked is of effects that are hidden where they could not, and of those that are there though not
hidden: a gap of more than 0.01 mm, a mode more than the law has.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from certainty import loss
from certainty import rows as bin_rows
from guess_pads import GuessPad, pads
from msgspec import to_builtins
from numpy.typing import NDArray
from registration import FOLDER
from results import Origin, Table

from qlvbayes.effects.catalogue import EFFECTS, names
from qlvbayes.guess.features import COMMON, LISTED, OWN, GuessFeatures, features_of
from qlvbayes.guess.guess import Member, Weights, guessed, standardised
from qlvbayes.io.files import write_json
from qlvbayes.laws.scales import TOLERANCE

Array = NDArray[np.float64]

RUN = "support"  # of blind studies, whose pads are simulated
MEMBERS = 5
FOLDS = 5
_CORE = ("evidence", "beside_rival", "rival_beside", "ahead", "beside_two")
_CORE_RIDGE = 3.0  # penalty on the weight of one of these standardised features,
_RIDGE = 100.0  # of any other, of which there are more than hidden effects,
_BIAS_RIDGE = 10.0  # and on an effect's own constant
_CORE_OF_RECORD = ("best", "unlisted", "no_discrepancy", "no_discrepancy_beside", "misfit")
_CORE_RECORD_RIDGE = 5.0  # the same where a record's features are all there is: of these,
_RECORD_RIDGE = 10.0  # and of the others
_GAP_MM = 0.01  # from which a gap counts as a contact offset that is there
_MARGIN = 1.5  # times the largest distance learnt from, beyond which a record is unlike
_SHRUNK = 1.0  # of the unit matrix in the covariance of the record's features


@dataclass(frozen=True, eq=False)
class Learnt:
    """The lesson of a pad: its features, and of each question the answer and whether it is asked.

    effects, asked (E,): of each effect that the tests can show; nothing, unlisted: answers, None
    where they are not asked.
    """

    pad: GuessPad
    features: GuessFeatures
    effects: NDArray[np.bool_]
    asked: NDArray[np.bool_]
    nothing: bool | None
    unlisted: bool | None


def learnt_from(pad: GuessPad) -> Learnt:
    """Return what one pad teaches."""
    case, features = pad.case, features_of(pad.responses)
    there, hidden = pad.families(shown=True), pad.families(shown=False)
    unknown = (hidden | pad.anyway) - there
    if case["rig"]["gap_mm"] < _GAP_MM:
        unknown -= {"contact_offset"} - hidden
    nothing = not any(pad.shown.values())
    unlisted = any(shown and not case["kin"][name] for name, shown in pad.shown.items())
    share = case["unlisted"]["share_of_peak"] if "unlisted" in case else 0.0  # of a lifelike pad
    return Learnt(
        pad,
        features,
        np.array([name in there for name in features.effects]),
        np.array([name not in unknown for name in features.effects]),
        None if nothing and 0.0 < share <= TOLERANCE else nothing and share == 0.0,
        None if 0.0 < share <= TOLERANCE else unlisted or share > TOLERANCE,
    )


def weights_of(some: Sequence[Learnt], seed: int, origin: dict[str, str | int]) -> Weights:
    """Return the weights learnt from some pads, each member from another draw of them."""
    rows = np.concatenate([one.features.rows for one in some])
    common = np.array([one.features.common for one in some])
    mean, sd = rows.mean(axis=0), np.maximum(rows.std(axis=0), 0.1)
    count = common.shape[1]
    mean[-count:], sd[-count:] = common.mean(axis=0), np.maximum(common.std(axis=0), 0.1)
    z = (common - mean[-count:]) / sd[-count:]
    precision = np.linalg.inv(np.cov(z.T) + _SHRUNK * np.eye(count))
    farthest = _MARGIN * float(np.sqrt(np.einsum("ni,ij,nj->n", z, precision, z).max()))
    rng = np.random.default_rng(seed)
    draws = [rng.integers(len(some), size=len(some)) for _ in range(MEMBERS)]
    members = [_member([some[k] for k in draw], mean, sd) for draw in draws]
    return Weights(
        mean.tolist(), sd.tolist(), precision.tolist(), farthest, members, origin
    )  # fmt: skip


def _member(some: Sequence[Learnt], mean: Array, sd: Array) -> Member:
    every = sorted(LISTED)
    z = np.concatenate([standardised(one.features.rows, mean, sd) for one in some])
    own = np.array([name == np.array(every) for one in some for name in one.features.effects])
    there = np.concatenate([one.effects for one in some]).astype(float)
    asked = np.concatenate([one.asked for one in some])
    ridges = [_CORE_RIDGE if name in _CORE else _RIDGE for name in (*OWN, *COMMON)]
    penalty = np.concatenate([ridges, np.full(len(every), _BIAS_RIDGE)])
    weights = logistic(np.column_stack([z, own])[asked], there[asked], penalty)
    split = 1 + z.shape[1]
    own_mean, own_sd = mean[-len(COMMON) :], sd[-len(COMMON) :]
    records = np.array([standardised(one.features.common, own_mean, own_sd) for one in some])
    core = [name in _CORE_OF_RECORD for name in COMMON]
    ridge = np.where(core, _CORE_RECORD_RIDGE, _RECORD_RIDGE)
    of_record = []
    for answers in ([one.nothing for one in some], [one.unlisted for one in some]):
        known = np.array([answer is not None for answer in answers])
        true = np.array([float(bool(answer)) for answer in answers])
        of_record.append(logistic(records[known], true[known], ridge).tolist())
    bias = dict(zip(every, weights[split:].tolist(), strict=True))
    return Member(weights[:split].tolist(), bias, *of_record)


def logistic(x: Array, there: Array, penalty: Array) -> Array:
    """Return weights (1 + F,) by penalised likelihood, the constant first; x (n, F), there (n,)."""
    design = np.column_stack([np.ones(len(x)), x])
    ridge = np.concatenate([[1e-6], penalty])
    weights = np.zeros(design.shape[1])
    for _ in range(50):  # Newton's method, which ends in under twenty
        share = 1.0 / (1.0 + np.exp(-np.clip(design @ weights, -30.0, 30.0)))
        slope = design.T @ (share - there) + ridge * weights
        curvature = (design.T * (share * (1.0 - share))) @ design + np.diag(ridge)
        step = np.linalg.solve(curvature, slope)
        weights = weights - step * min(1.0, 5.0 / max(float(np.abs(step).max()), 1e-12))
    return weights


@dataclass(frozen=True, eq=False)
class Answer:
    """A probability for a question that was asked of a pad, that of prior rates, and the truth."""

    question: str
    probability: float
    rate: float
    there: bool


NOTHING, UNLISTED = "nothing missing", "something that no list holds"


def answers(held: Learnt, learnt: Weights, rates: dict[str, float]) -> list[Answer]:
    """Return what a guess says of a pad that was left out; nothing where it gives no guess."""
    guess = guessed(held.pad.key[0], held.features, learnt)
    if guess.nothing is None or guess.unlisted is None:
        return []
    some = [
        Answer(name, guess.effects[name].probability, rates[name], bool(there))
        for name, there, asked in zip(held.features.effects, held.effects, held.asked, strict=True)
        if asked
    ]
    pairs = ((NOTHING, guess.nothing, held.nothing), (UNLISTED, guess.unlisted, held.unlisted))
    for question, likely, truth in pairs:
        if truth is not None:
            some.append(Answer(question, likely.probability, rates[question], truth))
    return some


def rates_of(some: Sequence[Learnt]) -> dict[str, float]:
    """Return how often the answer to each question is yes, with half a pad of each added."""
    hits: dict[str, list[bool]] = {name: [] for name in (*LISTED, NOTHING, UNLISTED)}
    for one in some:
        for name, there, asked in zip(one.features.effects, one.effects, one.asked, strict=True):
            if asked:
                hits[name].append(bool(there))
        for name, truth in ((NOTHING, one.nothing), (UNLISTED, one.unlisted)):
            hits[name] += [] if truth is None else [truth]
    return {name: (sum(some) + 0.5) / (len(some) + 1.0) for name, some in hits.items()}


def left_out(
    some: Sequence[Learnt], counted: Sequence[Learnt], parts: Callable[[Learnt], object], seed: int
) -> dict[tuple[str, int], list[Answer]]:
    """Return the answers about each counted pad by what the pads of all other parts teach."""
    found = {}
    for part in dict.fromkeys(map(parts, counted)):
        rest = [one for one in some if parts(one) != part]
        learnt, rates = weights_of(rest, seed, {}), rates_of(rest)
        for one in counted:
            if parts(one) == part:
                found[one.pad.key] = answers(one, learnt, rates)
    return found


def fold_of(some: Sequence[Learnt], seed: int) -> Callable[[Learnt], int]:
    """Return the function from a pad to its fifth, drawn at random."""
    order = np.random.default_rng(seed).permutation(len(some))
    folds = {one.pad.key: int(order[k]) % FOLDS for k, one in enumerate(some)}
    return lambda one: folds[one.pad.key]


def loss_of(some: Iterable[Answer], rate: bool = False) -> float:
    """Return the mean log loss (nats) of answers, or of the prior rates instead."""
    some = list(some)
    given = np.array([one.rate if rate else one.probability for one in some])
    return loss(given, np.array([float(one.there) for one in some]))


def losses(by_fold: Sequence[Answer], by_programme: Sequence[Answer]) -> list[list[str]]:
    """Return the rows of the table of log losses: all effects, each that is there often, others."""
    questions: list[tuple[str, set[str]]] = [("all effects", set(LISTED))]
    questions += [(name, {name}) for name in (*names(EFFECTS), NOTHING, UNLISTED)]
    table = []
    for words, of in questions:
        own = [one for one in by_fold if one.question in of]
        other = [one for one in by_programme if one.question in of]
        there = sum(one.there for one in own)
        if there and other:
            cells = loss_of(own), loss_of(own, rate=True), loss_of(other)
            table.append([words, str(len(own)), str(there), *(f"{cell:.3f}" for cell in cells)])
    return table


def bins(by_fold: Sequence[Answer]) -> list[list[str]]:
    """Return the rows of the table of calibration, of effects and of the other two questions."""
    table = []
    for words, of in (("effects", LISTED), (NOTHING, {NOTHING}), (UNLISTED, {UNLISTED})):
        own = [one for one in by_fold if one.question in of]
        given = np.array([one.probability for one in own])
        there = np.array([float(one.there) for one in own])
        table += [[words, *row] for row in bin_rows(given, there)]
    return table


def first_of(some: dict[tuple[str, int], list[Answer]], counted: Sequence[Learnt]) -> str:
    """Return in words how often a single hidden effect that can be seen is guessed first."""
    singles = [
        one for one in counted
        if one.pad.case["kind"] == "single" and one.pad.case["seen"] and some[one.pad.key]
    ]  # fmt: skip
    places, named = [], []
    for one in singles:
        own = [a for a in some[one.pad.key] if a.question in LISTED]
        own.sort(key=lambda answer: -answer.probability)
        places.append(next((k for k, answer in enumerate(own) if answer.there), len(own)))
        if "verdict" in one.pad.case:
            named.append(set(one.pad.case["effects"]) >= set(one.pad.case["names"]))
    first, three = (sum(place < most for place in places) for most in (1, 3))
    return (
        f"Of {len(singles)} pads with one hidden effect that can be seen, it is guessed first in "
        f"{first}, and among the first three in {three}; of the {len(named)} of them that are of "
        f"the run *{RUN}*, `diagnose` named it in {sum(named)}."
    )


def main() -> int:
    """Learn, write the weights, and count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pads", type=int, default=100, help="simulated pads to learn from")
    parser.add_argument("--seed", type=int, default=1, help="of lifelike pads, parts and draws")
    parser.add_argument("--keep", metavar="NAME", help="keep the tables of a registered count")
    parser.add_argument("-o", "--output", type=Path, required=True, help="file of the weights")
    options = parser.parse_args()
    origin = Origin.now() if options.keep else None  # before the weights are other ones
    command = {"run": RUN, "seed": options.seed, "pads": options.pads}
    some = [learnt_from(pad) for pad in pads(RUN, options.pads, options.seed)]
    write_json(
        options.output, to_builtins(weights_of(some, options.seed, dict(command))), indent=None
    )
    if origin:
        registered = json.loads((FOLDER / f"{options.keep}.json").read_text(encoding="utf-8"))
        if any(registered[key] != value for key, value in command.items()):
            sys.exit(f"registered are {registered}")
        developed = {tuple(key) for key in registered["developed"]}
        counted = [one for one in some if one.pad.key not in developed]
        keep(some, counted, options.seed, origin)
    return 0


def keep(some: Sequence[Learnt], counted: Sequence[Learnt], seed: int, origin: Origin) -> None:
    """Write the tables of the counted pads, those with which the features were not chosen."""
    by_fold = left_out(some, counted, fold_of(some, seed), seed)
    by_programme = left_out(some, counted, lambda one: one.pad.programme, seed)
    every, other = (
        [one for own in found.values() for one in own] for found in (by_fold, by_programme)
    )
    refused = [sum(not own for own in found.values()) for found in (by_fold, by_programme)]
    notes = [
        f"{len(counted)} pads are counted; no guess is given for {refused[0]} of them, and for "
        f"{refused[1]} where pads of their programme are not learnt from.",
        first_of(by_fold, counted),
    ]
    columns = ["question", "asked", "yes", "log loss", "of prior rates", "other programmes"]
    Table(origin, len(counted), columns, losses(every, other), notes).write("guess")
    columns = ["question", "probability", "asked", "yes", "95 % bounds", "mean probability"]
    Table(origin, len(counted), columns, bins(every), []).write("guess_bins")


if __name__ == "__main__":
    sys.exit(main())
