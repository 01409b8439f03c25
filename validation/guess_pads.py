"""Simulated pads for the first guess: responses of their effects, and what is hidden in them.

The pads are those of a registered run of blind studies that are made soonest, of which it is known
what the tests could show, and lifelike pads of a seed. Each finished pad lies in build/guess, so
that an interrupted run goes on where it was; the responses there depend on the code that made them.
"""

from __future__ import annotations

import pickle
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import zip_longest

from blind.counting import Case, true_names
from blind.population import KINDS, Population
from blind.study import make_study as make_blind
from blind.visible import SEEN, visible
from lifelike import truth_of
from lifelike_pads import make_study as make_lifelike
from lifelike_sizes import SEEN as RATIO
from registration import Registration
from results import BUILD
from runs import read_cases

from qlvbayes.guess.responses import Responses, responses_of
from qlvbayes.io.data import Pad
from qlvbayes.io.files import write_whole
from qlvbayes.motion.experiment import prepare

LIFELIKE_EVERY = 10  # one pad of so many is a lifelike one


@dataclass(frozen=True, eq=False)
class GuessPad:
    """A simulated pad: its study with its truth, and the responses of one fit.

    population: name of the run, or ``lifelike``; case: with `blind.case`'s keys of the truth;
    seconds: of CPU, for simulation and for responses.
    """

    population: str
    case: Case
    responses: Responses
    seconds: tuple[float, float]

    @property
    def key(self) -> tuple[str, int]:
        """Population and index of the pad."""
        return self.population, self.case["index"]

    @property
    def programme(self) -> str:
        """Kind of programme that the platen followed."""
        strata = self.case["strata"]
        return strata["protocol"] if "protocol" in strata else f"lifelike {strata['programme']}"

    @property
    def anyway(self) -> set[str]:
        """Effects that are there though not hidden, given the laws of the fit."""
        base = {"relaxation": self.responses.base[1]}
        return true_names(self.case | {"base": base, "names": [], "kin": {}, "kind": "none"})

    @property
    def shown(self) -> dict[str, bool]:
        """Visibility in the tests of each thing that is hidden, by its name."""
        ratios, expected = self.case.get("ratios"), self.case.get("detectability")
        if ratios is not None:
            return {name: ratio >= RATIO for name, ratio in ratios.items()}
        if expected is not None:
            return {name: value > SEEN for name, value in expected.items()}
        return dict.fromkeys(self.case["names"], bool(self.case["seen"]))

    def families(self, shown: bool) -> set[str]:
        """Listed effects that are hidden, or whose form is, which the tests could show or not."""
        kin = {name: {name} for name in self.case["names"]}
        if self.case["kind"] not in ("single", "double"):
            kin = {name: set(some) for name, some in self.case["kin"].items()}
        return set().union(*(kin[name] for name, own in self.shown.items() if own is shown))


def pads(run: str, count: int, seed: int) -> Iterator[GuessPad]:
    """Return ``count`` pads, simulated where they are not stored; one in 10 is lifelike.

    A pad that cannot be made or fitted is reported on standard error and left out.
    """
    population = Registration.read(run).population
    cases = soonest(read_cases(run))
    for number in range(count):
        block, place = divmod(number, LIFELIKE_EVERY)
        name, index, make = "lifelike", block, partial(_lifelike, seed, block)
        if place != LIFELIKE_EVERY - 1:
            case = cases[number - block]
            name, index, make = run, case["index"], partial(_blind, population, case)
        try:
            yield _stored(name, index, make)
        except Exception as error:  # one pad of hundreds
            print(f"{name} {index} is left out: {error}", file=sys.stderr)


def soonest(cases: Sequence[Case]) -> list[Case]:
    """Return studies by how soon they are made, one of each kind of what is hidden in turn."""

    def cost(case: Case) -> tuple[bool, float]:
        return case["strata"]["logger"] == "full", case["seconds"]["simulate"]

    of_kind = [sorted((c for c in cases if c["kind"] == kind), key=cost) for kind in KINDS]
    return [case for turn in zip_longest(*of_kind) for case in turn if case is not None]


def _blind(population: Population, case: Case) -> tuple[Case, Pad]:
    study = make_blind(population, case["index"])
    several = len(case["names"]) > 1 and not case["seen"]
    return case | ({"detectability": visible(study)} if several else {}), study.pad


def _lifelike(seed: int, index: int) -> tuple[Case, Pad]:
    study = make_lifelike(seed, index)
    return {"index": index, **truth_of(study), "ratios": study.seen}, study.pad


def _stored(population: str, index: int, make: Callable[[], tuple[Case, Pad]]) -> GuessPad:
    path = BUILD.parent / "guess" / f"{population}-{index}.pickle"
    if path.exists():
        pad: GuessPad = pickle.loads(path.read_bytes())
        return pad
    path.parent.mkdir(parents=True, exist_ok=True)
    times = [time.process_time()]
    case, record = make()
    times.append(time.process_time())
    responses = responses_of(prepare(record))
    times.append(time.process_time())
    pad = GuessPad(population, case, responses, (times[1] - times[0], times[2] - times[1]))
    write_whole(path, pickle.dumps(pad))
    return pad
