"""Is the best mode of the true hypothesis found whatever the starts, and by the search?

Does another seed of starts lead the search to the same hypotheses? Bundled pads and pads of the
wide population are searched. Interrupted, it goes on where it was.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from blind.population import Population
from blind.study import BlindStudy, make_study
from numpy.typing import NDArray
from results import JOBS, ROOT, Origin, Table, finished, share
from truth import Rig, is_modelled, truths

from qlvbayes.diagnosis.candidate import described
from qlvbayes.diagnosis.diagnose import run_search
from qlvbayes.diagnosis.search import CHECKS, Search
from qlvbayes.diagnosis.searchsetup import build_search
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.io.data import Pad, read_measurements
from qlvbayes.io.runtime import forget_compiled, one_blas_thread
from qlvbayes.motion.experiment import Experiment, prepare

Array = NDArray[np.bool_]
_SAME = 0.5  # of the log density, within which two sets of starts came to one mode
_NEAR = 5.0  # log posterior behind the best, within which another seed should see the same
_OTHER = 1  # seed of the second search
_EVERY = 4  # simulated pads, of which one is searched twice

COLUMNS = (
    "pads", "sets that agree", "pads in which all agree", "seen", "not seen, less probable",
    "missed",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pads", type=int, default=100, help="simulated ones")
    parser.add_argument("--sets", type=int, default=20, help="sets of starts")
    parser.add_argument("--seed", type=int, default=303, help="of the wide population")
    parser.add_argument("--jobs", type=int, default=JOBS)
    options = parser.parse_args()
    origin, bundled = Origin.now(), len(_bundled())
    study = partial(run, options.seed, options.sets)
    name = f"modes-seed{options.seed}-sets{options.sets}"
    found = finished(name, study, range(bundled + options.pads), options.jobs)
    table(found, bundled, Population(options.seed), origin).write("modes")


def run(seed: int, sets: int, index: int) -> dict[str, Any]:
    """Search the modes of one pad, of which the bundled ones are the first."""
    bundled = _bundled()
    number = index - len(bundled)
    some = bundled[index] if number < 0 else make_study(Population(seed), number)
    name = some.name if isinstance(some, Pad) else some.pad.name
    found = _looked_for(some, sets, twice=number < 0 or number % _EVERY == 0)
    forget_compiled()
    return {"index": index, "pad": name, **found}


def _bundled() -> list[Pad]:
    files = [ROOT / "data" / name for name in ("pads.csv", "hidden.csv")]
    return [pad for file in files for pad in read_measurements(file).pads]


def _looked_for(some: Pad | BlindStudy, sets: int, twice: bool) -> dict[str, Any]:
    """Return the losses of the hypothesis asked for, by every set and the search; inf if none.

    With them: by how much its log posterior is behind that of the search's likeliest hypothesis,
    and the search's checks for missed modes. twice: whether another seed is searched from too.
    """
    experiment = prepare(some if isinstance(some, Pad) else some.pad)
    search = build_search(experiment)
    with one_blas_thread():
        run_search(search)
        hypothesis = search.best
        if isinstance(some, BlindStudy):
            hypothesis = _true(some, experiment, search) or hypothesis
        grown = [_grown(experiment, hypothesis, seed) for seed in range(1, sets + 1)]
        own = {"twice": _twice(search, _again(experiment))} if twice else {}
    seen = [one.mode.loss for one in search.modes.get(hypothesis, [])]
    best = max([search.log_posterior(hypothesis), *(log for _, log in grown)])
    return {
        "hypothesis": described(hypothesis),
        "losses": [loss for loss, _ in grown],
        "seen": min(seen, default=float("inf")),
        "behind": search.log_posterior(search.best) - best,
        "checks": {name: vars(one) for name, one in search.checks.items()},
        **own,
    }


def _grown(experiment: Experiment, hypothesis: Hypothesis, seed: int) -> tuple[float, float]:
    """Return the lowest loss and the log posterior to which a search restricted to one way leads.

    It begins as any search does, from draws of the baseline's priors, and adds what the hypothesis
    has in addition, one law or effect at a time, the likeliest of them first.
    """
    search = build_search(experiment)
    search.seed = seed
    search.begin()
    here = search.baseline
    while here != hypothesis:
        laws = [
            replace(here, **{part: getattr(hypothesis, part)}) for part in ("elastic", "relaxation")
        ]
        steps = [*laws, *(here.plus(name) for name in hypothesis.effects - here.effects)]
        steps = [one for one in steps if one != here]
        search.expand(here, steps)
        known = [one for one in steps if one in search.modes]
        if not known:
            return float("inf"), float("-inf")
        here = max(known, key=search.log_posterior)
    return min(one.mode.loss for one in search.modes[here]), search.log_posterior(here)


def _again(experiment: Experiment) -> Search:
    """Return a whole search from another seed."""
    again = build_search(experiment)
    again.seed = _OTHER
    run_search(again)
    return again


def _twice(one: Search, two: Search) -> dict[str, Any]:
    """Hypotheses that either search has near its best, and those that both have alike.

    apart: the differences of their log posteriors; inf where the other has not seen one. errors: of
    the log evidences behind them.
    """
    searches = one, two
    best = max(search.log_posterior(search.best) for search in searches)
    near = {
        hypothesis
        for search in searches
        for hypothesis in search.modes
        if search.log_posterior(hypothesis) > best - _NEAR
    }
    apart = [one.log_posterior(h) - two.log_posterior(h) for h in near]
    return {
        "apart": [abs(value) for value in apart],
        "errors": [max(_error(search, h) for search in searches) for h in near],
        "best": described(one.best) == described(two.best),
    }


def _error(search: Search, hypothesis: Hypothesis) -> float:
    """Return the error of a log evidence; nothing where that is not known."""
    found = search.modes.get(hypothesis)
    return float(np.nan_to_num(found[0].error)) if found else 0.0


def _true(study: BlindStudy, experiment: Experiment, search: Search) -> Hypothesis | None:
    """The true hypothesis, with the rig's gap or without, which of them the search takes for more.

    None where nothing of the package stands for something that is hidden.
    """
    if not is_modelled(effect.name for effect in study.effects):
        return None
    every = truths(study.law, study.effects, Rig.of(study, experiment))
    known = [one.hypothesis for one in every]
    known = [one for one in known if one.effects <= set(search.density.space.effects)]
    return max(known, key=search.log_posterior, default=None)


def table(found: Sequence[dict], bundled: int, population: Population, origin: Origin) -> Table:
    """Return what was found in pads of which so many, the first, are bundled."""
    losses = [np.array([*one["losses"], one["seen"]]) for one in found]
    every = [own <= own.min() + _SAME for own in losses]
    agreeing, seen = [one[:-1] for one in every], [bool(one[-1]) for one in every]
    behind = [one["behind"] for one in found]
    rows = [
        _row(words, [(agreeing[k], seen[k], behind[k]) for k in some])
        for words, some in _groups(found, bundled, population).items()
        if some
    ]
    return Table(origin, len(found), COLUMNS, rows, [_counted(found), _agreeing(found)])


def _groups(found: Sequence[dict], bundled: int, population: Population) -> dict[str, list[int]]:
    """Indices of the bundled pads, and of the simulated ones without an outsider and with one."""
    groups: dict[str, list[int]] = {
        "bundled": list(range(min(bundled, len(found)))),
        "simulated, the true hypothesis": [],
        "simulated with an outsider, the likeliest hypothesis": [],
    }
    _, true, likeliest = groups.values()
    for k in range(bundled, len(found)):
        names = population.item(found[k]["index"] - bundled).names
        (true if is_modelled(names) else likeliest).append(k)
    return groups


def _row(words: str, pads: list[tuple[Array, bool, float]]) -> list[str]:
    """A row of the table: of each pad which sets agree, whether it was seen, and how far behind."""
    sets, agree = sum(a.size for a, _, _ in pads), sum(int(a.sum()) for a, _, _ in pads)
    known = sum(seen for _, seen, _ in pads)
    unseen = [behind for _, seen, behind in pads if not seen]
    less = sum(behind > _SAME for behind in unseen)
    whole = sum(bool(a.all()) for a, _, _ in pads)
    return [
        f"{len(pads)} {words}", share(agree, sets), str(whole), share(known, len(pads)),
        str(less), str(len(unseen) - less),
    ]  # fmt: skip


def _counted(found: Sequence[dict]) -> str:
    """Return how often each check was made, failed, and led to a likelier mode."""
    said = []
    for name in CHECKS:
        made, failed, higher = (
            sum(one["checks"][name][key] for one in found) for key in ("made", "failed", "higher")
        )
        said.append(f"{name} made {made} times, failed {failed}, led to a likelier mode {higher}")
    return f"Checks for missed modes over all searches: {'; '.join(said)}."


def _agreeing(found: Sequence[dict]) -> str:
    """In how many pads, and in how many of the hypotheses that count, two seeds agree."""
    repeated = [one["twice"] for one in found if "twice" in one]
    apart = np.array([value for one in repeated for value in one["apart"]])
    errors = np.array([value for one in repeated for value in one["errors"]])
    alike = apart <= np.maximum(_SAME, 3.0 * errors)
    same = sum(one["best"] for one in repeated)
    return (
        f"Of {len(repeated)} pads searched from two seeds {same} have the same likeliest "
        f"hypothesis; of {apart.size} "
        f"hypotheses within {_NEAR:g} of the best log posterior of either search "
        f"{int(alike.sum())} have the same one in both (to {_SAME:g}, or to three of its errors), "
        f"and {int(np.isinf(apart).sum())} were seen by one of the two only."
    )


if __name__ == "__main__":
    main()
