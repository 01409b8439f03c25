"""Simulate pads on which a next test is proposed and done: bits expected and bits realised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qlvbayes import Choices
from qlvbayes.diagnosis.candidate import described
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.nexttest.belief import Belief
from qlvbayes.diagnosis.nexttest.design import Design, draw_designs
from qlvbayes.diagnosis.nexttest.errors import ReadingErrors
from qlvbayes.diagnosis.nexttest.hypotheses import explanation_of_mode
from qlvbayes.diagnosis.nexttest.rig import Rig
from qlvbayes.diagnosis.nexttest.screening import screen
from qlvbayes.diagnosis.nexttest.series import Goal, Option, bits_for_constants, plan_series
from qlvbayes.diagnosis.nexttest.suggest import cause_of
from qlvbayes.diagnosis.prior import Families
from qlvbayes.diagnosis.result import DiagnosisResult
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.searchsetup import as_chosen, build_search
from qlvbayes.effects.catalogue import EFFECTS, FORMS, OUTSIDE
from qlvbayes.evaluation.study import measured
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.io.data import Pad, Test
from qlvbayes.io.units import PAD
from qlvbayes.motion.experiment import Experiment, prepare
from qlvbayes.motion.noisefloor import NoiseFloor
from qlvbayes.pipeline.designing import probable_alternatives
from qlvbayes.simulate import (
    HIDDEN,
    NOISES,
    Constants,
    HiddenPad,
    Hold,
    Move,
    Platen,
    draw_constants,
    draw_effect,
    paper_protocol,
    record_study,
    record_test,
)

ROWS = 500  # a test, as its logger keeps
STANDARD = Design(1.6, 20.0, 1000.0, hold=30.0, share=0.5, rest=30.0)
MINUTES = 10.0
SCREENED = 512
RATES = (0.1, 1.0, 20.0, 100.0)  # mm/s, of the pads whose cause is asked
FIRST = ((20.0,), (1.0, 20.0, 100.0))  # mm/s, of the tests that a pad of known cause has, in turn
UNLISTED = ("slip", "backlash", "sensor_nonlinearity", "poroelastic_diffusion")
"""Hidden in turn, of no candidate's form."""
SIZES = (0.03, 0.08)  # share of the peak force, of these
FAMILIES = Families.from_kinds((*EFFECTS, *FORMS, *OUTSIDE))


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
        """Return the proposed test, done after its pause."""
        steps: list[Move | Hold] = []
        for stroke in design.strokes:
            steps += [Move(stroke.target, stroke.speed), Hold(stroke.hold)]
        start = clock + design.wait
        platen = Platen(tuple(steps), design.acceleration, start)
        own = record_test(self.pad, platen, NOISES["correlated"], self.rng, max_rows=ROWS)
        return Test(name, "B", own.time, own.displacement, own.force, start_s=start)


def ready(tests: Sequence[Test], floor: NoiseFloor | None = None) -> Experiment:
    """Prepare tests; floor: of the noise, where it is not to be measured in these tests."""
    found = as_chosen(prepare(Pad("B", tuple(tests), PAD)), Choices())
    return found if floor is None else replace(found, floor=floor)


def believed(search: Search, found: Sequence[tuple[Hypothesis, float]]) -> Belief:
    some = []
    for hypothesis, probability in found:
        one = search.modes[hypothesis][0]
        some.append(
            explanation_of_mode(
                search.density, hypothesis, one.point, one.evidence.covariance, one.mode.size,
                probability, described(hypothesis), cause_of(hypothesis.effects, FAMILIES),
            )
        )  # fmt: skip
    return Belief.from_explanations(some)


def plain(
    tests: Sequence[Test], floor: NoiseFloor | None = None
) -> tuple[Experiment, Belief, float]:
    """Return the belief in the plain model alone, and its discrepancy's size."""
    experiment = ready(tests, floor)
    search = build_search(experiment, kinds=())
    search.evaluate(search.baseline)
    size = search.modes[search.baseline][0].mode.size
    return experiment, believed(search, [(search.baseline, 1.0)]), size


def constants_case(index: int, seed: int) -> dict:
    """Return expected and realised bits for all constants, and sds, of some next tests of a pad.

    Realised twice: with the noise measured anew in all tests, as a user would see it, and with the
    noise held at what the expectation assumed. Keys of a case stay: `promised` is what is expected.
    """
    rng = np.random.default_rng([seed, index])
    constants: Constants = draw_constants(rng)
    lab = Lab(HiddenPad(constants, ()), rng)
    first = lab.tests(FIRST[index % len(FIRST)], int(rng.integers(2**32)))
    experiment, belief, size = plain(first)
    floor, scales, one = experiment.floor, experiment.scales, belief.explanations[0]
    rig = Rig.from_tests(experiment)
    errors = ReadingErrors(floor, scales.force, size)
    sds = np.linalg.norm(one.gradient, axis=1) / np.abs(one.centre)
    worst = one.names[int(np.argmax(sds))]
    series = plan_series(
        belief, rig, errors, Goal((worst,), False), minutes=MINUTES, tests=1, clock=scales.clock,
        seed=index, count=SCREENED,
    )  # fmt: skip
    recovery = belief.recovery
    options = {"proposed": series.tests[0].design, "standard": recovery.before(STANDARD)}
    some = draw_designs(rig, recovery, 60.0 * MINUTES, 64, 1000 + index)
    options["random"] = some[int(rng.integers(len(some)))]
    products, _ = screen(belief, list(options.values()), rig, errors, scales.clock)
    expected = bits_for_constants(belief, products, belief.base_names)
    after = products.sds(0, one.gradient)
    rows = []
    row = one.names.index(worst)
    for k, (name, design) in enumerate(options.items()):
        tests = [*first, lab.done(design, name, scales.clock)]
        anew, then, _ = plain(tests)
        new, held = then.explanations[0], plain(tests, floor)[1].explanations[0]
        rows.append(
            {
                "test": name,
                "words": design.words(PAD),
                "minutes": design.minutes,
                "promised": float(expected[k]),
                "realised": _volume(one) - _volume(new),
                "held": _volume(one) - _volume(held),
                "noise": anew.floor.total / floor.total,
                "sd_now": float(np.linalg.norm(one.gradient[row])),
                "sd_promised": float(after[k, row]),
                "sd_realised": float(np.linalg.norm(new.gradient[row])),
                "sd_held": float(np.linalg.norm(held.gradient[row])),
            }
        )
    return {"index": index, "kind": "constants", "first": len(first), "worst": worst,
            "missed": size, "rows": rows}  # fmt: skip


def _volume(one) -> float:  # type: ignore[no-untyped-def]
    """Return log2 of the volume of what is not known of the constants, in their own numbers.

    The fractions sum to one, so that one of them is left out.
    """
    kept = [k for k, name in enumerate(one.names) if name != "c[0]"]
    relative = one.gradient[kept] / one.centre[kept, None]
    return float(0.5 * np.linalg.slogdet(relative @ relative.T)[1] / np.log(2.0))


@dataclass(frozen=True, eq=False)
class Doubt:
    """Explanations that a diagnosis left open, with their probabilities, and the rig."""

    experiment: Experiment
    known: list[tuple[Hypothesis, float]]
    belief: Belief
    rig: Rig
    errors: ReadingErrors

    @classmethod
    def of(cls, experiment: Experiment, search: Search, result: DiagnosisResult) -> Doubt:
        known = [
            (
                Hypothesis(*one.base.pair, search.baseline.effects | set(one.effects)),
                one.probability,
            )
            for one in probable_alternatives(result.alternatives, FAMILIES)
            or result.alternatives[:1]
        ]
        return cls(
            experiment, known, believed(search, known), Rig.from_tests(experiment),
            ReadingErrors(experiment.floor, experiment.scales.force, result.discrepancy),
        )  # fmt: skip

    def best(self, wish: Goal, seed: int) -> Option:
        """Return the one test that is proposed."""
        return plan_series(
            self.belief, self.rig, self.errors, wish, minutes=MINUTES, tests=1,
            clock=self.experiment.scales.clock, seed=seed, count=SCREENED,
        ).tests[0]  # fmt: skip

    def expected(self, designs: Sequence[Design]) -> list[list[float]]:
        """Return the bits expected for the cause, at least and at most, of each design."""
        clock = self.experiment.scales.clock
        products, _ = screen(self.belief, designs, self.rig, self.errors, clock)
        bounds = products.bits_for_cause(self.belief.probabilities, self.belief.groups)
        return np.transpose(bounds).tolist()


def cause_case(index: int, seed: int) -> dict:
    """Try whether a proposed test, a random one as long and the standard one resolve a pad.

    The pad has a drag that grows nearly as the speed; what is asked is which of the causes that the
    diagnosis left is right. Their probabilities are computed again with the additional test.
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
    doubt = Doubt.of(experiment, found.work.search, found.result)
    best, recovery = doubt.best(Goal((), True), index).design, doubt.belief.recovery
    near = [
        one
        for one in draw_designs(doubt.rig, recovery, 60.0 * MINUTES, 1024, 2000 + index)
        if 0.8 < one.minutes / best.minutes < 1.25
    ]
    options = {"proposed": best, "standard": recovery.before(STANDARD)}
    if near:
        options["random"] = near[int(rng.integers(len(near)))]
    expected = doubt.expected(list(options.values()))
    before = _log_posteriors(experiment, doubt.known)
    case |= {"entropy": doubt.belief.entropy, "causes": doubt.belief.causes}
    case["rows"] = [
        {"test": name, "words": one.words(PAD), "minutes": one.minutes, "promised": expected[j],
         "after": _after(lab, first, one, name, doubt, before)}
        for j, (name, one) in enumerate(options.items())
    ]  # fmt: skip
    return case


def _after(
    lab: Lab, first: Sequence[Test], design: Design, name: str, doubt: Doubt, before: np.ndarray
) -> dict[str, float]:
    """Return the causes' probabilities, reweighted by what the new test adds to each evidence."""
    clock = doubt.experiment.scales.clock
    after = _log_posteriors(ready([*first, lab.done(design, name, clock)]), doubt.known)
    logs = np.log([p for _, p in doubt.known]) + after - before
    shares = np.exp(logs - logs.max())
    found: dict[str, float] = {}
    for (hypothesis, _), share in zip(doubt.known, shares / shares.sum(), strict=True):
        cause = cause_of(hypothesis.effects, FAMILIES)
        found[cause] = found.get(cause, 0.0) + float(share)
    return found


def _log_posteriors(
    experiment: Experiment, known: Sequence[tuple[Hypothesis, float]]
) -> np.ndarray:
    """Return the log posteriors of some hypotheses, up to a constant."""
    names = {effect for hypothesis, _ in known for effect in hypothesis.effects}
    own = {FAMILIES.family_of[name] for name in names}
    kinds = tuple(kind for kind in Choices().candidates if kind.name in own)
    search = build_search(experiment, kinds=kinds)
    search.begin()
    for hypothesis, _ in known:
        bare = replace(hypothesis, effects=search.baseline.effects)
        search.evaluate(bare)
        search.evaluate(hypothesis, bare)
    return np.array([search.log_posterior(hypothesis) for hypothesis, _ in known])


def outside_case(index: int, seed: int) -> dict:
    """Try whether a pad whose cause is in no list looks certain after the proposed test."""
    rng = np.random.default_rng([seed, 2000 + index])
    constants, name = draw_constants(rng), UNLISTED[index % len(UNLISTED)]
    size = float(np.exp(rng.uniform(*np.log(SIZES))))
    peak = constants.m / constants.b * np.expm1(constants.b * STANDARD.depth)
    hidden = draw_effect(name, rng, peak, STANDARD.depth, max(RATES), size, constants)
    lab = Lab(HiddenPad(constants, (hidden,)), rng)
    first = lab.tests(RATES, int(rng.integers(2**32)))
    experiment = ready(first)
    found = diagnose(experiment)
    doubt = Doubt.of(experiment, found.work.search, found.result)
    cause = len(doubt.belief.groups) > 1
    best = doubt.best(Goal(doubt.belief.base_names, cause), index)
    test = lab.done(best.design, "proposed", experiment.scales.clock)
    then = diagnose(ready([*first, test])).result
    return {
        "index": 2000 + index, "kind": "outside", "hidden": name, "size": size,
        "words": best.design.words(PAD), "minutes": best.design.minutes,
        "entropy": doubt.belief.entropy, "promised": [best.cause, best.cause_most],
        "missed": found.result.discrepancy,
        "before": found.result.outside, "after": then.outside,
        "verdicts": [found.result.verdict, then.verdict],
        "likeliest": [list(one.alternatives[0].effects) for one in (found.result, then)],
    }  # fmt: skip


__all__ = ["MINUTES", "SCREENED", "cause_case", "constants_case", "outside_case"]
