r"""Compute what each effect would add to the force of one fit, and what it would gain there.

The model without effects is fitted once, with each of the known laws in turn, and the most probable
pair of laws is kept. About its mode the force of any further effect is linear in its amplitude a,
in units of the prior's sd: y = f + J x + a r, where r is the force (N) that the effect adds at a
given shape, over its amplitude. Under a discrepancy of size s (`inference.errors.discrepancy`),
whose precision is Q, the constants x follow at their best. With the residual e and the prior's
gradient p and curvature P,

.. math:: A = J Q J^T + P, \quad b = J Q e - p, \quad
          g = r Q e - r Q J^T A^{-1} b, \quad H = r Q r - r Q J^T A^{-1} J Q r,

the log likelihood ratio of amplitudes a against none is a g - a H a / 2. Each effect is taken at
half a sd, about 2.5 % of the largest force, at several quantiles of its shape's prior, in both
directions where its amplitude has a sign, and in all its forms. Of each direction the shape that
gains most is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from qlvbayes.diagnosis.prior import scale_amplitudes
from qlvbayes.diagnosis.search import Search
from qlvbayes.diagnosis.searchsetup import build_search, protocol_of
from qlvbayes.effects.effect import Protocol
from qlvbayes.inference.density import Density
from qlvbayes.inference.forward.hypothesis import Hypothesis
from qlvbayes.inference.modes import Mode, base_modes, find_mode
from qlvbayes.inference.starts import over_shapes, starts, transferred
from qlvbayes.io.arrays import Array
from qlvbayes.io.checks import NoFiniteForceError
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import Experiment
from qlvbayes.motion.phases import KINDS, phase_index

_STARTS = 1  # draws of the priors from which the plain model is fitted, and redrawn relaxations
_ROUGH = 1.0  # expected rise of the log density at which the fit of another law ends
_AMPLITUDE = 0.5  # sds of the prior at which responses are taken: 2.5 % of the largest force
_EVERY = 2  # of the sizes of the discrepancy, which are close to one another


@dataclass(frozen=True, eq=False)
class Responses:
    """The residual of one fit, and the K responses of effects, projected off the constants.

    families (K,): the effect that each is a form of; signed (K,): whether its amplitude may be
    negative; losses (S,), gradients (S, K), curvatures (S, K, K): minus the log density without
    effects, g and H at each size of the discrepancy, the first of which is zero; left (n,), own (K,
    n): residual and responses (N) by unweighted least squares; test, phase (n,): of each block
    mean; noise (n,): its sd (N); peak (N); laws: log density that each other law adds to the plain
    model; base: the laws of the fit; size: the likeliest of the discrepancy (N); protocol: what the
    tests do.
    """

    families: tuple[str, ...]
    signed: NDArray[np.bool_]
    losses: Array
    gradients: Array
    curvatures: Array
    left: Array
    own: Array
    test: NDArray[np.intp]
    phase: NDArray[np.intp]
    noise: Array
    peak: float
    laws: dict[str, float]
    base: tuple[str, str]
    size: float
    protocol: Protocol


def responses_of(experiment: Experiment, choices: Choices | None = None) -> Responses:
    """Return the responses of all effects that the tests can show, about the best plain fit.

    Raises
    ------
    NoFiniteForceError
        The plain model has no finite force in these tests.
    """
    choices = choices or Choices()
    search = build_search(experiment, choices)
    density, mode, laws = _fitted(search)
    rows = list(_rows(density, mode, search))
    added = density.whitener.flattened(np.stack([row[3] for row in rows]))
    keep = _best_shapes(density, mode, rows, added)
    rows, added = [rows[k] for k in keep], added[keep]
    sizes = np.unique(np.append(density.discrepancy.sizes[1::_EVERY], 0.0))
    expansions = [_projected(density, mode, added, size) for size in sizes.tolist()]
    slopes = density.whitener.flattened(mode.point.responses)
    basis, _ = np.linalg.qr(slopes.T)
    force = np.asarray(density.space.record.blocks.force)
    left = density.whitener.flattened((force - mode.point.predicted)[None])[0]
    losses, gradients, curvatures = (np.stack(some) for some in zip(*expansions, strict=True))
    family_of = search.families.family_of
    return Responses(
        tuple(family_of[row[0]] for row in rows),
        np.array([row[2] for row in rows]),
        losses, gradients, curvatures,
        left - (left @ basis) @ basis.T,
        added - (added @ basis) @ basis.T,
        density.whitener.tests,
        _phases(experiment, density),
        density.whitener.sds,
        density.discrepancy.peak,
        laws,
        mode.point.own.hypothesis.base,
        mode.size,
        protocol_of(experiment, bonded=choices.bonded),
    )  # fmt: skip


def _fitted(search: Search) -> tuple[Density, Mode, dict[str, float]]:
    """Return the density with scaled amplitudes, the best plain mode, and what each law adds."""
    plain = search.baseline
    draws = search.density.space.prior_draws(plain, search.seed)[:_STARTS]
    drawn = base_modes(search.density, plain, draws, search.seed, _STARTS)
    if not drawn:
        raise NoFiniteForceError
    density = scale_amplitudes(
        search.density, plain, drawn[0].point, search.families, search.settings
    )
    best = find_mode(density, plain, drawn[0].point.theta) or drawn[0]
    laws = {}
    others = [("relaxation", name) for name in density.space.relaxation]
    others += [("elastic", name) for name in search.nameable_laws]
    for part, name in others:
        hypothesis = best.point.own.hypothesis
        if getattr(plain, part) == name:
            continue
        changed = (name, hypothesis.relaxation), (hypothesis.elastic, name)
        other = Hypothesis(*changed[part == "relaxation"], hypothesis.effects)
        start = starts(density.space, best.point, other, 1, (1.0, 1.0), 1)[0]
        mode = find_mode(density, other, start, best.loss, _ROUGH, guess=best.size)
        if mode is not None:
            prior = search.log_prior(other) - search.log_prior(hypothesis)
            laws[name] = best.loss - mode.loss + prior
            best = mode if laws[name] > 0.0 else best
    best = find_mode(density, best.point.own.hypothesis, best.point, guess=best.size) or best
    return density, best, laws


Row = tuple[str, float, bool, Array]


def _rows(density: Density, mode: Mode, search: Search) -> list[Row]:
    """Return name, amplitude (sds), whether it is signed, and response (T, B) of all trials."""
    space, point, breadth = density.space, mode.point, search.breadth
    rows: list[Row] = []
    for name in search.families.addable(search.baseline.effects):
        hypothesis = point.own.hypothesis.plus(name)
        parameters = space.parameters(hypothesis)
        amplitude = parameters.amplitude_of.get(name)
        if amplitude is None:
            continue
        theta = transferred(point.own, point.theta, parameters)
        own = search.families.family_of[name] == name
        shapes = breadth.shapes if own else 1
        none = np.stack(over_shapes(space, parameters, name, theta, shapes))
        signed = bool(parameters.lowest[amplitude.number] == -np.inf)
        sizes = [_AMPLITUDE, -_AMPLITUDE] if signed else [_AMPLITUDE]
        thetas = np.repeat(none[None], len(sizes), axis=0)
        thetas[:, :, amplitude.number] += np.array(sizes)[:, None] * amplitude.sd
        every = np.concatenate([none, thetas.reshape(-1, none.shape[1])])
        forces = space.forces(hypothesis, parameters.constants(every))
        forces = np.where(space.real, forces, 0.0)
        without, added = forces[: len(none)], forces[len(none) :]
        for (size, shape), force in zip(product(sizes, range(len(none))), added, strict=True):
            response = (force - without[shape]) / size
            if np.isfinite(response).all():
                rows.append((name, size, signed, response))
    return rows


def _best_shapes(density: Density, mode: Mode, rows: Sequence[Row], added: Array) -> list[int]:
    """Return of each effect and size the index of the shape that gains most."""
    _, gradient, curvature = _projected(density, mode, added, mode.size)
    best: dict[tuple[str, float], tuple[float, int]] = {}
    for k, (name, size, signed, _) in enumerate(rows):
        toward = gradient[k] if signed else max(gradient[k], 0.0)
        gain = float(toward**2 / (1.0 + curvature[k, k]))
        if (name, size) not in best or gain > best[name, size][0]:
            best[name, size] = gain, k
    return sorted(k for _, k in best.values())


def _projected(
    density: Density, mode: Mode, added: Array, size: float
) -> tuple[float, Array, Array]:
    """Return the loss without effects, g (K,) and H (K, K) at one size (N) of the discrepancy."""
    point = mode.point
    discrepancy = density.discrepancy.at(size, point.separation)
    terms = point.added_terms(density.whitener.whiten(added), discrepancy)
    shares = np.interp(size, density.discrepancy.sizes, density.discrepancy.log_prior)
    return terms.loss - float(shares), -terms.gradient, terms.curvature


def _phases(experiment: Experiment, density: Density) -> NDArray[np.intp]:
    """Return the kind of phase (n,) that each block mean lies in, as an index of `KINDS`."""
    blocks = density.space.record.blocks
    middle = 0.5 * (np.asarray(blocks.first) + np.asarray(blocks.last))
    kinds = []
    for trial, times, own in zip(experiment.trials, middle, density.whitener.blocks, strict=True):
        which = phase_index(trial.phases, times[own])
        names = np.array([KINDS.index(phase.kind) for phase in trial.phases])
        kinds.append(names[which])
    return np.concatenate(kinds)
