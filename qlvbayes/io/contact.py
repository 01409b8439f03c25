"""Find the sign of pressing and the point of first contact, from the data alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qlvbayes.io.arrays import Array as Floats

_PLAIN = 2.0  # ratio of the force's larger swing to the other one, above which its sign is clear
_TRAVEL = 0.2  # share of the whole travel that must lie between the start and the peak force
_REST = 0.2  # share of the largest force up to which a test begins without force
_STILL = 1e-3  # share of the travel within which rows at the beginning are at one position
_MOVED = 0.01  # share of the whole travel above which the platen has left its start
_AWAY = 2.0  # standard errors of contact that an approach is longer
_NOTHING = 2.0  # in sds of the noise: a smaller change of force is no response
_LEVELS = (0.05, 0.15, 0.3)  # shares of the peak force up to which the rise is fitted, in turn
_HIGHER = (0.5, 0.8)  # further shares, for a press with too few rows below those
_WANTED = 2  # number of fitted levels below which the higher ones are tried
_MIDDLE = 1  # index of the level whose result is taken; the others give the spread of the choice
_SINGULAR = 1e-10  # relative volume of two columns, below which it is rounding
_EXACT = 1e-12  # share of the squared force that readings without noise leave at least
_CONSTANTS = 5.0  # fitted constants: force before contact, point, power, two of the rise
_LEAST = 6  # rows before contact that an approach needs
_FEW = 4  # rows beyond the contact that a rise of two constants needs
_MOST = 250  # means of rows that the fit uses; more add little
_GRID = 41  # points tried, then tried again between the neighbours of the best
_ROUNDS = 4
_SLIDING = (0.01, 0.02, 0.05, 0.1)  # shares of the travel after which a guide slides, in turn
_STEP = 5.0  # sds of single readings by which the force of a guide that slides stands out
_LONG = 2.0  # ways of the step for which a guide slides on at one force, unlike a rise that slows
_FLAT = 0.1  # share of that force by which it may change until contact
UNLIKELY = 12.0  # log likelihood below the best power's, beyond which a power is ignored

Form = tuple[float, float]
"""A beginning of the force at contact: with a power of depth, after a jump (N) of drag."""
FORMS: tuple[Form, ...] = tuple((power, 0.0) for power in (1.0, 1.5, 2.0, 2.5, 3.0))
"""The forms of a test without drag, equally probable beforehand."""


@dataclass(frozen=True)
class Signs:
    """Factors of displacement and force, -1 where the sign changes, and any doubt.

    ``travel`` is the displacement at the peak force, from the start, as a share of the whole
    travel. ``rank`` is how much it decides on others of its file: 2 where it begins at rest, 1
    where it begins loaded and the force grows, 0 where it is in doubt, as one that begins at its
    largest force.
    """

    way: int
    load: int
    travel: float
    doubt: str = ""
    rank: int = 2


def find_signs(way: Floats, load: Floats) -> Signs:
    """Return the signs from the data alone: the force moves mostly to the pressed side."""
    start = force_at_start(way, load)
    up, down = float(load.max()) - start, start - float(load.min())
    if up == down == 0.0:  # a force that never changes presses, and what creeps goes with it
        return Signs(1 if way[-1] >= way[0] else -1, 1 if start >= 0.0 else -1, 1.0)
    sign = 1 if up >= down else -1
    peak = int(np.argmax(sign * load))
    span = float(way.max() - way.min())
    travel = float(way[peak] - way[0]) / span if span else 0.0
    side = 1 if travel >= 0.0 else -1
    loaded = abs(start) > _REST * float(np.abs(load).max())
    doubt = ""
    if max(up, down) < _PLAIN * min(up, down):
        doubt = f"the force swings to both sides ({up:.3g} up, {down:.3g} down)"
    elif abs(travel) < _TRAVEL:
        doubt = f"the peak force lies {abs(travel):.0%} of the travel from the start"
    elif loaded and sign * start < 0.0:
        contact = find_contact(side * way, sign * load)  # in the air the force has any zero
        if contact is None or not contact.is_beyond(float(side * way[0])):
            doubt = f"the force is largest where the test begins ({start:.3g}), as in a retraction"
    return Signs(side, sign, abs(travel), doubt, 0 if doubt else 1 if loaded else 2)


def rest_of(way: Floats, share: float = _STILL) -> int:
    """Return the number of rows at the first position, within a share of the travel; 0 for all."""
    return int(np.argmax(np.abs(way - way[0]) > share * float(np.ptp(way))))


def force_at_start(way: Floats, load: Floats) -> float:
    """Return the median force until the platen has moved."""
    return float(np.median(load[: max(rest_of(way, _MOVED), 1)]))


def level_at_rest(way: Floats, load: Floats) -> tuple[float, float]:
    """Return the mean force at the first position, and its standard error."""
    rest = load[: max(rest_of(way), 1)]
    return float(rest.mean()), float(rest.std()) / float(np.sqrt(max(_independent(rest), 1.0)))


def scatter(values: Floats) -> float:
    """Return the sd of the noise of single readings (n,), from their second differences."""
    return float(np.median(np.abs(np.diff(values, 2)))) / (0.6745 * np.sqrt(6.0))


def is_dead(way: Floats, load: Floats) -> bool:
    """Return whether the force does not respond to the displacement, and is noise only."""
    away, moved = np.abs(way - way[0]), rest_of(way, _MOVED)
    noise = max(scatter(load), float(np.std(load[:moved])) if moved >= _LEAST else 0.0)
    deep = load[away > 0.5 * float(away.max())]
    response = abs(float(np.median(deep)) - force_at_start(way, load))
    return response < _NOTHING * noise and float(np.std(load)) < _NOTHING * noise


def is_driven_back(way: Floats) -> bool:
    """Return whether a displacement goes back by half of its travel, as nothing creeps."""
    deepest = int(np.argmax(np.abs(way - way[0])))
    return abs(float(way[-1] - way[deepest])) > 0.5 * abs(float(way[deepest] - way[0]))


@dataclass(frozen=True)
class FirstContact:
    """Point of first contact and the force before it, each with its standard error.

    ``position`` and ``sd`` are displacements; ``rows`` is the number of rows before contact. Where
    the force of a moving platen is another one than that at rest, ``force`` is the one at rest,
    ``sliding`` is how much more the platen feels as it moves, and ``slid`` the number of rows until
    then.
    """

    position: float
    sd: float
    force: float
    tare_sd: float
    rows: int
    level: float  # share of the peak force up to which the rise is fitted
    choice: float = 0.0  # error due to this share
    spacing: float = 0.0  # error due to the rows' distance
    sliding: float = 0.0  # force, of a contact after sliding alone
    slid: int = 0

    @property
    def is_finite(self) -> bool:
        """Return whether place and force have an error each."""
        return bool(np.all(np.isfinite([self.position, self.sd, self.tare_sd])))

    def is_beyond(self, start: float) -> bool:
        """Return whether the platen was moved before contact from a first position."""
        return self.position - start > _AWAY * self.sd


def find_contact(way: Floats, load: Floats, *, at_zero: bool = False) -> FirstContact | None:
    r"""Return the first contact of a test that presses to positive; None if it starts in contact.

    Up to a share of the peak force

    .. math:: F(d) = F_0 + a x^p + b x^{p+1}, \qquad x = \max(d - d_0, 0)

    is fitted. Powers p of 1 to 3 are equally probable beforehand. The point and its standard error
    are mean and sd over them, each weighted by its likelihood with as many independent rows as the
    residual's correlation leaves. The spread over three shares of the peak force (larger ones for a
    quick press) and the spacing of the rows at contact are added in squares. ``way`` and ``load``
    (n,) may be in any units. ``at_zero``: whether it begins at the file's own zero, where a soft
    rise is taken for no late contact. Lin, Dimitriadis & Horkay 2007, doi:10.1115/1.2800826.
    """
    fits: list[FirstContact] = []
    known = 0
    for level in (*_LEVELS, *_HIGHER):
        # a soft rise looks late high up: below, it has too few rows, or no approach
        if level in _HIGHER and known >= _WANTED:
            break
        d, f = _risen(way, load, level)
        found = _onsets(d, f, FORMS) if len(d) >= _LEAST + _FEW and d[-1] > d[0] else None
        known += found is not None and (at_zero or len(found) > 0)
        if found is not None and len(found):
            force = f[d <= found[np.argmax(found[:, 2]), 0]]
            own = float(np.std(force)) / np.sqrt(max(_independent(force), 1.0))
            fits.append(FirstContact(*mean_over_forms(found), float(force.mean()), own, 0, level))
    if not fits:
        return None
    middle = fits[min(_MIDDLE, len(fits) - 1)]
    row = int(np.argmax(way > middle.position))
    # the last row before the rise: noise at rest may cross the contact long before
    before = np.flatnonzero(way[: int(np.argmax(way)) + 1] <= middle.position)
    last = int(before[-1]) if before.size else 0
    spacing = abs(float(way[min(last + 1, len(way) - 1)] - way[last])) / np.sqrt(12.0)
    spread = float(np.std([fit.position for fit in fits]))
    sd = float(np.sqrt(middle.sd**2 + spread**2 + spacing**2))
    return replace(middle, sd=sd, rows=row, choice=spread, spacing=spacing)


def first_rises(
    way: Floats, load: Floats, *, at_zero: bool
) -> tuple[FirstContact | None, FirstContact | None]:
    """Return the first contact of a test, and the one after sliding if what rises first may rub.

    As a platen whose guide rubs begins to move, the force steps to another level, at which it stays
    for a way at least ``_LONG`` times as long as that of the step, and then begins to rise as at a
    contact.
    """
    contact = find_contact(way, load, at_zero=at_zero)
    moved = rest_of(way)
    if (contact is not None and contact.is_beyond(float(way[0]))) or moved < _LEAST:
        return contact, None
    noise, (rest, sd) = float(np.std(load[:moved])), level_at_rest(way, load)
    for share in _SLIDING:
        first = int(np.argmax(way - way[0] > share * float(np.ptp(way))))
        found = find_contact(way[first:], load[first:])
        if found is None or not found.is_beyond(float(way[first])):
            continue
        long = found.position - float(way[first]) > _LONG * float(way[first] - way[0])
        early, late = np.array_split(load[first : first + found.rows], 2)
        step = float(np.mean(late)) - rest
        flat = abs(float(np.mean(late) - np.mean(early))) < _FLAT * abs(step)
        if long and flat and abs(step) > _STEP * max(noise, float(np.std(late))):
            rows = first + found.rows
            return contact, replace(
                found, force=rest, tare_sd=sd, rows=rows, sliding=step, slid=first
            )
    return contact, None


def most_slide(sliding: Sequence[FirstContact | None]) -> bool:
    """Return whether most tests of a rig, and two at least, show a contact after sliding.

    A guide rubs in every test; in a single one a drag that relaxes looks alike.
    """
    return sum(one is not None for one in sliding) > max(1.0, 0.5 * len(sliding))


def onsets_of(way: Floats, load: Floats, level: float, forms: Sequence[Form]) -> Floats | None:
    """Return (forms, 3) of the rise up to a share of the peak force.

    Each row has the point of contact if the force begins with that form, its standard error, and
    the log likelihood less that of the likeliest form. There is no row where few readings lie
    before the best point, and they are unknown (None) where few lie beyond.
    """
    return _onsets(*_risen(way, load, level), forms)


def _risen(way: Floats, load: Floats, level: float) -> tuple[Floats, Floats]:
    """Return displacement and force up to a share of the peak force, averaged."""
    first = force_at_start(way, load)
    top = first + level * (float(load.max()) - first)
    peak = int(np.argmax(load >= first + 0.9 * (float(load.max()) - first)))
    size = peak - int(np.argmax(load[peak::-1] <= top)) + 1  # up to the last row below the level
    count = -(-size // _MOST)  # rows of a mean
    whole = size // count * count
    d, f = (values[:whole].reshape(-1, count).mean(axis=1) for values in (way, load))
    return d, f


def _onsets(d: Floats, f: Floats, forms: Sequence[Form]) -> Floats | None:
    tried = [_best_point(d, f, form) for form in forms]
    misfits, points = (np.array(column) for column in zip(*tried, strict=True))
    best = int(np.argmin(misfits))
    before = d <= points[best]
    if np.count_nonzero(~before) < _FEW:
        return None
    if np.count_nonzero(before) < _LEAST:
        return np.empty((0, 3))
    _, a, b, rise, further = _solved(d, f, points[best : best + 1], forms[best])
    fitted = a * rise[0] + b * further[0] + forms[best][1] * (d > points[best])
    free = max(_independent(f - (fitted - fitted.mean() + f.mean())) - _CONSTANTS, 1.0)
    least = max(float(misfits[best]), _EXACT * float(f @ f))
    heights = -0.5 * free * np.log(np.maximum(misfits, least) / least)
    limits = np.maximum(misfits, least) * (1.0 + 1.0 / free)
    sds = [
        _width(d, f, form, float(point), float(limit)) if height > -UNLIKELY else 0.0
        for form, point, limit, height in zip(forms, points, limits, heights, strict=True)
    ]
    return np.stack([points, sds, heights], axis=1)


def mean_over_forms(found: Floats) -> tuple[float, float]:
    """Return mean and sd of the point of contact over the forms (forms, 3) of `onsets_of`."""
    points, sds, heights = found.T
    likely = heights - heights.max() > -UNLIKELY
    shares = np.exp(heights[likely] - heights.max())
    weights = shares * sds[likely]
    if not weights.any():  # each form begins at one place exactly
        weights = shares
    weights /= weights.sum()
    point = float(weights @ points[likely])
    return point, float(np.sqrt(weights @ (sds[likely] ** 2 + (points[likely] - point) ** 2)))


def _best_point(d: Floats, f: Floats, form: Form) -> tuple[float, float]:
    """Return the least squared error of a form, and its point of contact."""
    low, high = float(d.min()), float(d[-_FEW])
    for _ in range(_ROUNDS):
        points = np.linspace(low, high, _GRID)
        errors = _solved(d, f, points, form)[0]
        best = int(np.argmin(errors))
        low, high = float(points[max(best - 1, 0)]), float(points[min(best + 1, _GRID - 1)])
    return float(errors[best]), float(points[best])


def _solved(d: Floats, f: Floats, points: Floats, form: Form) -> tuple[Floats, ...]:
    """Return least squared errors, a and b (points,), and their x^p and x^(p+1) (points, n)."""
    (power, jump), span, count = form, float(d[-1] - d.min()), f.size
    x = np.maximum(d - points[:, None], 0.0) / span
    reach = np.maximum(d.max() - points, 0.0) / span
    whole, half = divmod(power, 1.0)  # powers are halves, which need no logarithm
    rise = x if whole == 1.0 else x * x if whole == 2.0 else x * x * x
    rise = rise * np.sqrt(x) if half else rise
    further = rise * x
    y = f - jump * (d > points[:, None]) if jump else f
    y = y - y.mean(axis=-1, keepdims=True)
    first, second = rise.sum(axis=1), further.sum(axis=1)
    aa = np.einsum("pn,pn->p", rise, rise) - first * first / count
    ab = np.einsum("pn,pn->p", rise, further) - first * second / count
    bb = np.einsum("pn,pn->p", further, further) - second * second / count
    if y.ndim == 1:
        ay, by, yy = rise @ y, further @ y, np.asarray(y @ y)
    else:
        ay, by, yy = (np.einsum("pn,pn->p", one, y) for one in (rise, further, y))
    risen = aa > _EXACT**2 * count  # else no row lies beyond contact
    volume = aa * bb - ab * ab
    regular = risen & (volume > _SINGULAR * aa * bb) & (volume > np.finfo(float).tiny)
    divisor = np.where(regular, volume, 1.0)
    a, b = (bb * ay - ab * by) / divisor, (aa * by - ab * ay) / divisor
    rises = regular & (a >= 0.0) & (power * a + (power + 1.0) * b * reach >= 0.0)
    a = np.where(rises, a, np.maximum(risen * ay / np.where(risen, aa, 1.0), 0.0))
    b = np.where(rises, b, 0.0)
    errors = yy - 2.0 * (a * ay + b * by) + a * a * aa + 2.0 * a * b * ab + b * b * bb
    return np.maximum(errors, 0.0), a, b, rise, further


def _width(d: Floats, f: Floats, form: Form, point: float, allowed: float) -> float:
    """Return half the width of the points whose squared error stays below ``allowed``."""
    ends = []
    for end, outward in ((float(d.min()), slice(None)), (float(d[-_FEW]), slice(None, None, -1))):
        away = end - point
        for _ in range(_ROUNDS):  # narrows the grid around the limit
            points = np.linspace(point + min(away, 0.0), point + max(away, 0.0), _GRID)
            within = (_solved(d, f, points, form)[0] <= allowed)[outward]
            limit = max(int(np.argmax(within)) - 1, 0)
            away = float(points[outward][limit]) - point
        ends.append(abs(away))
    return 0.5 * (ends[0] + ends[1])


def _independent(residual: Floats) -> float:
    """Return how many independent values a correlated series is worth: n (1 - r) / (1 + r)."""
    centred = residual - residual.mean()
    power = float(centred @ centred)
    if power <= 0.0 or len(residual) < 3:
        return float(len(residual))
    r = float(np.clip(centred[1:] @ centred[:-1] / power, 0.0, 0.99))
    return len(residual) * (1.0 - r) / (1.0 + r)
