"""Simulated pads on which a next test is proposed and done: what it promised, and what came."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qlvbayes import Choices
from qlvbayes.benchmark.study import measured
from qlvbayes.data import Pad, Test
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.search import Search, described
from qlvbayes.diagnosis.workbench import as_chosen, search_of
from qlvbayes.experiment import Experiment, prepare
from qlvbayes.inference.space import Hypothesis
from qlvbayes.nexttest.belief import Belief, normalised
from qlvbayes.nexttest.design import Design, drawn
from qlvbayes.nexttest.errors import Errors
from qlvbayes.nexttest.hypotheses import explanation_of_mode
from qlvbayes.nexttest.rig import Rig
from qlvbayes.nexttest.screening import screened
from qlvbayes.nexttest.series import Wish, bits_for_constants, planned_series
from qlvbayes.study.designing import LEAST, MOST
from qlvbayes.synthetic import (
    HIDDEN,
    NOISES,
    Constants,
    HiddenPad,
    Hold,
    Move,
    Platen,
    draw_constants,
    paper_protocol,
    record_study,
    record_test,
)
from qlvbayes.units import PAD

ROWS = 500  # a test, as its logger keeps
STANDARD = Design(1.6, 20.0, 1000.0, hold=30.0, share=0.5, rest=30.0)
MINUTES = 10.0
SCREENED = 512
RATES = (0.1, 1.0, 20.0, 100.0)  # mm/s, of the pads whose cause is asked
SURE = 0.9  # probability from which an explanation counts as found


@dataclass(frozen=True)
class Lab:
    """One simulated pad on its rig, and the random stream of its noise."""

    pad: HiddenPad
    rng: np.random.Generator

    def tests(self, rates: Sequence[float], seed: int) -> tuple[Test, ...]:
        programs = {f"{rate:g}": paper_protocol(rate) for rate in rates}
        return measured(
            record_study({"B": self.pad}, programs, NOISES["correlated"], seed, ROWS), "B"
        ).tests

    def done(self, design: Design, name: str, clock: float) -> Test:
        """The proposed test, done after its pause."""
        steps: list[Move | Hold] = []
        for stroke in design.strokes:
            steps += [Move(stroke.target, stroke.speed), Hold(stroke.hold)]
        start = clock + design.wait
        platen = Platen(tuple(steps), design.acceleration, start)
        own = record_test(self.pad, platen, NOISES["correlated"], self.rng, max_rows=ROWS)
        return Test(name, "B", own.time, own.displacement, own.force, start_s=start)


def ready(tests: Sequence[Test]) -> Experiment:
    return as_chosen(prepare(Pad("B", tuple(tests), PAD)), Choices())


def believed(search: Search, found: Sequence[tuple[Hypothesis, float]]) -> Belief:
    some = []
    for hypothesis, probability in found:
        one = search.modes[hypothesis][0]
        some.append(
            explanation_of_mode(
                search.density, hypothesis, one.point, one.evidence.covariance, one.mode.size,
                probability, described(hypothesis),
            )
        )  # fmt: skip
    return normalised(some)


def plain(tests: Sequence[Test]) -> tuple[Experiment, Belief, float]:
    """The belief in the plain model alone, and its discrepancy's size."""
    experiment = ready(tests)
    search = search_of(experiment, kinds=())
    search.see_plain(search.usual)
    size = search.modes[search.usual][0].mode.size
    return experiment, believed(search, [(search.usual, 1.0)]), size


def constants_case(index: int, seed: int) -> dict:
    """Promised and realised bits for all constants, and sds, of some next tests of a pad."""
    rng = np.random.default_rng([seed, index])
    constants: Constants = draw_constants(rng)
    lab = Lab(HiddenPad(constants, ()), rng)
    first = lab.tests((20.0,), int(rng.integers(2**32)))
    experiment, belief, size = plain(first)
    scales, one = experiment.scales, belief.explanations[0]
    rig = Rig.of_tests(experiment)
    errors = Errors(experiment.floor, scales.force, size)
    sds = np.linalg.norm(one.gradient, axis=1) / np.abs(one.centre)
    worst = one.names[int(np.argmax(sds))]
    series = planned_series(
        belief, rig, errors, Wish((worst,), False), minutes=MINUTES, tests=1, clock=scales.clock,
        seed=index, count=SCREENED, best=0,
    )  # fmt: skip
    recovery = belief.recovery
    options = {"proposed": series.tests[0].design, "standard": recovery.before(STANDARD)}
    some = drawn(rig, recovery, 60.0 * MINUTES, 64, 1000 + index)
    options["random"] = some[int(rng.integers(len(some)))]
    designs = list(options.values())
    products, _ = screened(belief, designs, rig, errors, scales.clock)
    promised = bits_for_constants(belief, products, belief.base_names)
    after = products.sds(0, one.gradient)
    rows = []
    place = one.names.index(worst)
    for k, (name, design) in enumerate(options.items()):
        test = lab.done(design, name, scales.clock)
        _, then, _ = plain([*first, test])
        new = then.explanations[0]
        rows.append(
            {
                "test": name,
                "words": design.words(PAD),
                "minutes": design.minutes,
                "promised": float(promised[k]),
                "realised": _volume(one) - _volume(new),
                "sd_now": float(np.linalg.norm(one.gradient[place])),
                "sd_promised": float(after[k, place]),
                "sd_realised": float(np.linalg.norm(new.gradient[place])),
            }
        )
    return {"index": index, "kind": "constants", "worst": worst, "missed": size, "rows": rows}


def _volume(one) -> float:  # type: ignore[no-untyped-def]
    """Log2 of the volume of what is not known of the constants, in their own numbers.

    The fractions sum to one, so that one of them is left out.
    """
    kept = [k for k, name in enumerate(one.names) if name != "c[0]"]
    relative = one.gradient[kept] / one.centre[kept, None]
    return float(0.5 * np.linalg.slogdet(relative @ relative.T)[1] / np.log(2.0))


def cause_case(index: int, seed: int) -> dict:
    """Whether a proposed test and a random one resolve an ambiguous pad, rightly.

    The pad has a drag that grows nearly as the speed; what is asked is which of the explanations
    that the diagnosis left is right, weighed again with the test more.
    """
    rng = np.random.default_rng([seed, 1000 + index])
    n, k = float(rng.uniform(0.8, 0.95)), float(rng.uniform(0.002, 0.005))
    lab = Lab(HiddenPad(draw_constants(rng), (HIDDEN["power_law_drag"](k=k, n=n),)), rng)
    first = lab.tests(RATES, int(rng.integers(2**32)))
    experiment = ready(first)
    found = diagnose(experiment)
    case = {"index": 1000 + index, "kind": "cause", "n": n, "k": k,
            "verdict": found.result.verdict, "group": list(found.result.group)}  # fmt: skip
    if found.result.verdict != "ambiguous":
        return case
    search = found.work.search
    likely = [one for one in found.result.alternatives if one.probability >= LEAST][:MOST]
    known = [
        (Hypothesis(*one.base.pair, search.usual.effects | set(one.effects)), one.probability)
        for one in likely
    ]
    belief = believed(search, known)
    scales, rig = experiment.scales, Rig.of_tests(experiment)
    errors = Errors(experiment.floor, scales.force, found.result.discrepancy)
    series = planned_series(
        belief, rig, errors, Wish((), True), minutes=MINUTES, tests=1, clock=scales.clock,
        seed=index, count=SCREENED, best=0,
    )  # fmt: skip
    best = series.tests[0]
    near = [
        one
        for one in drawn(rig, belief.recovery, 60.0 * MINUTES, 512, 2000 + index)
        if 0.8 < one.minutes / best.design.minutes < 1.25
    ]
    options = {"proposed": best.design}
    if near:
        options["random"] = near[int(rng.integers(len(near)))]
    case["entropy"], case["promised"] = belief.entropy, [best.cause, best.cause_most]
    before = _weighed(experiment, known)
    case["before"] = _right(known, np.log([p for _, p in known]))
    case["rows"] = [
        {"test": name, "words": one.words(PAD), "minutes": one.minutes,
         **_resolved(lab, first, one, name, scales.clock, known, before)}
        for name, one in options.items()
    ]  # fmt: skip
    return case


def _resolved(
    lab: Lab,
    first: Sequence[Test],
    design: Design,
    name: str,
    clock: float,
    known: Sequence[tuple[Hypothesis, float]],
    before: np.ndarray,
) -> dict:
    """The diagnosis's probabilities, times what the test more adds to each one's evidence."""
    after = _weighed(ready([*first, lab.done(design, name, clock)]), known)
    right = _right(known, np.log([p for _, p in known]) + after - before)
    return {"right": right, "resolved": right >= SURE, "wrong": right < 1 - SURE}


def _weighed(experiment: Experiment, known: Sequence[tuple[Hypothesis, float]]) -> np.ndarray:
    """Log posteriors of some hypotheses, up to a constant."""
    names = {effect for hypothesis, _ in known for effect in hypothesis.effects}
    kinds = tuple(kind for kind in Choices().candidates if kind.name in names)
    search = search_of(experiment, kinds=kinds)
    search.see_plain(search.usual)
    for hypothesis, _ in known:
        bare = replace(hypothesis, effects=search.usual.effects)
        search.see_plain(bare)
        search.see_rebased(bare, hypothesis)
    return np.array([search.log_posterior(hypothesis) for hypothesis, _ in known])


def _right(known: Sequence[tuple[Hypothesis, float]], logs: np.ndarray) -> float:
    """Probability of the hidden effect, on any base law."""
    shares = np.exp(logs - logs.max())
    hidden = np.array([hypothesis.effects == {"power_law_drag"} for hypothesis, _ in known])
    return float(shares[hidden].sum() / shares.sum())


__all__ = ["MINUTES", "SCREENED", "SURE", "cause_case", "constants_case"]
