"""Which way presses, and where the platen touches: from the data alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.io.formats.format import Floats

_PLAIN = 2.0  # the larger swing of the force over the other one, from which on its sign is plain
_TRAVEL = 0.2  # share of the whole travel that must lie between the start and the peak force
_MOVED = 0.01  # share of the whole travel, from which on the platen has left its start
_LEVELS = (0.05, 0.15, 0.3)  # of the peak force, up to which the rise is looked at, in turn
_MIDDLE = 1  # the level whose answer is taken; the others tell how much the choice matters
_LEAST = 6  # rows before contact, below which there is no approach
_FEW = 4  # rows beyond the contact that a rise of two constants needs
_MOST = 500  # means of rows that the fit looks at; more tell little new
_GRID = 121  # places tried, then tried again between the neighbours of the best
_ROUNDS = 3


@dataclass(frozen=True)
class Signs:
    """Factors of displacement and force, -1 where turned over; why they are in doubt, if so.

    ``swing`` is the larger excursion of the force from its start over the other one; ``travel``
    the displacement at the peak force, from the start, as a share of the whole travel.
    """

    way: int
    load: int
    swing: float
    travel: float
    doubt: str = ""


def find_signs(way: Floats, load: Floats) -> Signs:
    """Signs from the data alone: force leaves its start mostly to the pressed side.

    A specimen that is pressed as far as it is pulled is in doubt, and one whose largest force is
    not away from where it began.
    """
    start = force_at_start(way, load)
    up, down = float(load.max()) - start, start - float(load.min())
    sense = 1 if up >= down else -1
    swing = max(up, down) / max(min(up, down), 1e-3 * max(up, down))
    peak = int(np.argmax(sense * load))
    span = float(way.max() - way.min())
    travel = float(way[peak] - way[0]) / span if span else 0.0
    signs = (1 if travel >= 0.0 else -1), sense
    if swing < _PLAIN:
        doubt = f"the force swings to both sides ({up:.3g} up, {down:.3g} down)"
    elif abs(travel) < _TRAVEL:
        doubt = f"the peak force lies {abs(travel):.0%} of the travel from the start"
    else:
        doubt = ""
    return Signs(*signs, swing, abs(travel), doubt)


def force_at_start(way: Floats, load: Floats) -> float:
    """Median force until the platen has moved."""
    moved = int(np.argmax(np.abs(way - way[0]) > _MOVED * float(np.ptp(way))))
    return float(np.median(load[: max(moved, 1)]))


@dataclass(frozen=True)
class Contact:
    """First contact: place and its standard error (in displacement), force before it and its own.

    ``rows`` is the number of rows before contact.
    """

    place: float
    sd: float
    force: float
    force_sd: float
    rows: int


def find_contact(way: Floats, load: Floats) -> Contact | None:
    """First contact of a test in which pressing is positive; None where it starts in contact.

    Up to a share of the peak force F(d) = F0 + a x + b x^2 with x = max(d - d0, 0) is fitted, which
    spans a linear toe (an exponential law), a Hertzian one, and one that relaxes as it rises. The
    standard error of d0 is that of the profile of the squared error, with as many independent rows
    as the residual's correlation leaves; added to it in squares are the spread over the three
    shares and the spacing of the rows at contact.
    """
    found = [_fitted(way, load, level) for level in _LEVELS]
    middle = found[_MIDDLE]
    if middle is None:
        return None
    places = [fit.place for fit in found if fit is not None]
    row = int(np.argmax(way > middle.place))
    spacing = abs(float(way[row] - way[max(row - 1, 0)])) / np.sqrt(12.0)
    spread = float(np.std(places)) if len(places) > 1 else 0.0
    sd = float(np.sqrt(middle.sd**2 + spread**2 + spacing**2))
    return Contact(middle.place, sd, middle.force, middle.force_sd, row)


def _fitted(way: Floats, load: Floats, level: float) -> Contact | None:
    first = force_at_start(way, load)
    top = first + level * (float(load.max()) - first)
    peak = int(np.argmax(load >= first + 0.9 * (float(load.max()) - first)))
    last = peak - int(np.argmax(load[peak::-1] <= top))  # the last row of the rise below the level
    d, f = _averaged(way[: last + 1]), _averaged(load[: last + 1])
    if len(d) < _LEAST + _FEW or d[-1] <= d[0]:
        return None
    low, high = float(d.min()), float(d[-1])
    for _ in range(_ROUNDS):
        places = np.linspace(low, high, _GRID)
        errors = _errors(d, f, places)
        best = int(np.argmin(errors))
        low, high = float(places[max(best - 1, 0)]), float(places[min(best + 1, _GRID - 1)])
    place = float(places[best])
    before = d <= place
    if np.count_nonzero(before) < _LEAST or np.count_nonzero(~before) < _FEW:
        return None
    force = f[before]
    own = float(np.std(force)) / np.sqrt(max(_independent(force), 1.0))
    free = max(_independent(f - _rises(d, f, places[best : best + 1])[0]) - 4.0, 1.0)
    sd = _width(d, f, place, float(errors[best]) * (1.0 + 1.0 / free))
    return Contact(place, sd, float(force.mean()), own, 0)


def _averaged(values: Floats) -> Floats:
    """Means of so many rows in turn that at most ``_MOST`` are left."""
    many = -(-len(values) // _MOST)
    if many == 1:
        return values
    whole = len(values) // many * many
    return values[:whole].reshape(-1, many).mean(axis=1)


def _rises(d: Floats, f: Floats, places: Floats) -> Floats:
    """The best F0 + a x + b x^2 (places, rows) for each place of contact.

    a >= 0, and b so that the force does not fall again; where the best of all is not so, that
    with b = 0.
    """
    span = float(d[-1] - d.min())
    x = np.maximum(d - places[:, None], 0.0) / span
    square = np.stack([np.ones_like(x), x, x * x], axis=-1)
    curved, found = _solved(square, f)
    straight, _ = _solved(square[..., :2], f)
    rises = (found[:, 1] >= 0.0) & (found[:, 1] + 2.0 * found[:, 2] * x.max(axis=1) >= 0.0)
    return np.where(rises[:, None], curved, straight)


def _solved(columns: Floats, f: Floats) -> tuple[Floats, Floats]:
    """Least squares of ``f`` in columns (places, rows, k): values and coefficients."""
    turned = np.swapaxes(columns, 1, 2)
    inverse = np.linalg.pinv(turned @ columns, hermitian=True)
    found = (inverse @ (turned @ f)[..., None])[..., 0]
    return (columns @ found[..., None])[..., 0], found


def _errors(d: Floats, f: Floats, places: Floats) -> Floats:
    residual = f - _rises(d, f, places)
    return np.einsum("pr,pr->p", residual, residual)


def _width(d: Floats, f: Floats, place: float, allowed: float) -> float:
    """Half the width of the places whose squared error stays below the allowed one."""
    low, high = float(d.min()), float(d[-1])
    near, far = place - low, high - place
    for _ in range(_ROUNDS):  # closer and closer around the best
        below, above = (
            np.linspace(place - near, place, _GRID),
            np.linspace(place, place + far, _GRID),
        )
        left = int(np.argmax(_errors(d, f, below) <= allowed))
        right = _GRID - 1 - int(np.argmax(_errors(d, f, above)[::-1] <= allowed))
        near, far = (
            place - float(below[max(left - 1, 0)]),
            float(above[min(right + 1, _GRID - 1)]) - place,
        )
    return 0.5 * (near + far)


def _independent(residual: Floats) -> float:
    """How many independent values a correlated series is worth: n (1 - r) / (1 + r)."""
    centred = residual - residual.mean()
    power = float(centred @ centred)
    if power <= 0.0 or len(residual) < 3:
        return float(len(residual))
    r = float(np.clip(centred[1:] @ centred[:-1] / power, 0.0, 0.99))
    return len(residual) * (1.0 - r) / (1.0 + r)
