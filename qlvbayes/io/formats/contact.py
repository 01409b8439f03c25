"""Which way presses, and where the platen touches: from the data alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qlvbayes.io.formats.format import Floats

_PLAIN = 2.0  # the larger swing of the force over the other one, from which on its sign is plain
_TRAVEL = 0.2  # share of the whole travel that must lie between the start and the peak force
_MOVED = 0.01  # share of the whole travel, from which on the platen has left its start
_NOTHING = 2.0  # sds of the noise, below which a force has not answered
_LEVELS = (0.05, 0.15, 0.3)  # of the peak force, up to which the rise is looked at, in turn
_HIGHER = (0.5, 0.8)  # and up to which a press is, of which too few rows lie below those
_WANTED = 2  # levels, below which the higher ones are looked at
_MIDDLE = 1  # the level whose answer is taken; the others tell how much the choice matters
_POWERS = (1.0, 1.5, 2.0, 2.5, 3.0)  # of the depth, with which the force begins; one beyond 2.5
_SINGULAR = 1e-10  # of what two columns could span together: less is rounding
_EXACT = 1e-12  # of the squared force: readings without noise leave no less
_CONSTANTS = 5.0  # that are fitted: force before contact, place, power, two of the rise
_LEAST = 6  # rows before contact, below which there is no approach
_FEW = 4  # rows beyond the contact that a rise of two constants needs
_MOST = 250  # means of rows that the fit looks at; more tell little new
_GRID = 41  # places tried, then tried again between the neighbours of the best
_ROUNDS = 4
_UNLIKELY = 12.0  # log likelihood below the best power's, from which on one does not count


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


def scatter(values: Floats) -> float:
    """Standard deviation of the noise of single readings (n,), from their second differences."""
    return float(np.median(np.abs(np.diff(values, 2)))) / (0.6745 * np.sqrt(6.0))


def is_dead(way: Floats, load: Floats) -> bool:
    """Whether the force does not answer to the displacement: nothing but noise about one level."""
    deep = np.abs(way - way[0]) > 0.5 * float(np.abs(way - way[0]).max())
    moved = int(np.argmax(np.abs(way - way[0]) > _MOVED * float(np.ptp(way))))
    noise = max(scatter(load), float(np.std(load[:moved])) if moved >= _LEAST else 0.0)
    answer = abs(float(np.median(load[deep])) - force_at_start(way, load))
    return answer < _NOTHING * noise and float(np.std(load)) < _NOTHING * noise


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
    r"""First contact of a test in which pressing is positive; None where it starts in contact.

    Up to a share of the peak force

    .. math:: F(d) = F_0 + a x^p + b x^{p+1}, \qquad x = \max(d - d_0, 0)

    is fitted, which spans a linear toe (an exponential law), a sphere (p = 1.5), a cone (2) and
    one that relaxes as it rises. Powers p of 1 to 3 are equally likely beforehand; place and
    standard error are mean and sd over them, each weighed by its likelihood with as many
    independent rows as the residual's correlation leaves. Added to that in squares are the spread
    over three shares of the peak force and the spacing of the rows at contact. A quick press, of
    which few rows lie below those shares, is looked at up to larger ones.

    way, load (n,): displacement and force, in any units. Source: Lin, Dimitriadis & Horkay 2007,
    doi:10.1115/1.2800826 (contact as a free constant of the fit).
    """
    found = [fit for level in _LEVELS if (fit := _fitted(way, load, level)) is not None]
    for level in _HIGHER:
        if len(found) < _WANTED and (fit := _fitted(way, load, level)) is not None:
            found.append(fit)
    if not found:
        return None
    middle = found[min(_MIDDLE, len(found) - 1)]
    row = int(np.argmax(way > middle.place))
    spacing = abs(float(way[row] - way[max(row - 1, 0)])) / np.sqrt(12.0)
    spread = float(np.std([fit.place for fit in found]))
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
    tried = [_of_power(d, f, power) for power in _POWERS]
    misfits, places = (np.array(column) for column in zip(*tried, strict=True))
    best = int(np.argmin(misfits))
    before = d <= places[best]
    if np.count_nonzero(before) < _LEAST or np.count_nonzero(~before) < _FEW:
        return None
    force = f[before]
    own = float(np.std(force)) / np.sqrt(max(_independent(force), 1.0))
    rise = _rises(d, f, float(places[best]), _POWERS[best])
    free = max(_independent(f - rise) - _CONSTANTS, 1.0)
    least = max(float(misfits[best]), _EXACT * float(f @ f))
    heights = -0.5 * free * np.log(np.maximum(misfits, least) / least)
    likely = np.flatnonzero(heights > -_UNLIKELY)
    sds = np.array(
        [
            _width(d, f, _POWERS[k], float(places[k]), max(misfits[k], least) * (1.0 + 1.0 / free))
            for k in likely
        ]
    )
    weights = np.exp(heights[likely]) * sds  # with the place of contact integrated out
    weights /= weights.sum()
    place = float(weights @ places[likely])
    sd = float(np.sqrt(weights @ (sds**2 + (places[likely] - place) ** 2)))
    return Contact(place, sd, float(force.mean()), own, 0)


def _of_power(d: Floats, f: Floats, power: float) -> tuple[float, float]:
    """Least squared error of a power, and its place of contact."""
    low, high = float(d.min()), float(d[-1])
    for _ in range(_ROUNDS):
        places = np.linspace(low, high, _GRID)
        errors = _errors(d, f, places, power)
        best = int(np.argmin(errors))
        low, high = float(places[max(best - 1, 0)]), float(places[min(best + 1, _GRID - 1)])
    return float(errors[best]), float(places[best])


def _averaged(values: Floats) -> Floats:
    """Means of so many rows in turn that at most ``_MOST`` are left."""
    many = -(-len(values) // _MOST)
    if many == 1:
        return values
    whole = len(values) // many * many
    return values[:whole].reshape(-1, many).mean(axis=1)


def _rises(d: Floats, f: Floats, place: float, power: float) -> Floats:
    """The best F0 + a x^p + b x^(p+1) (n,) of a place of contact."""
    rise, further = _columns(d, np.array([place]), power)
    _, a, b = _solved(rise, further, f, power, _reach(d, np.array([place])))
    found = a[:, None] * rise + b[:, None] * further
    return np.asarray((found - found.mean(axis=1, keepdims=True))[0] + f.mean())


def _columns(d: Floats, places: Floats, power: float) -> tuple[Floats, Floats]:
    """x^p and x^(p+1) (places, n); powers are halves, which need no logarithm."""
    x = np.maximum(d - places[:, None], 0.0) / float(d[-1] - d.min())
    whole, half = divmod(power, 1.0)
    rise = x if whole == 1.0 else x * x if whole == 2.0 else x * x * x
    rise = rise * np.sqrt(x) if half else rise
    return rise, rise * x


def _reach(d: Floats, places: Floats) -> Floats:
    """The largest x (places,)."""
    return np.asarray(np.maximum(d.max() - places, 0.0) / float(d[-1] - d.min()))


def _solved(
    rise: Floats, further: Floats, f: Floats, power: float, reach: Floats
) -> tuple[Floats, Floats, Floats]:
    """Least squared errors (places,), and a and b of x^p and x^(p+1).

    a >= 0, and b so that the force does not fall again; where the best of all is not so, that
    with b = 0.
    """
    count = len(f)
    y = f - f.mean()
    first, second = rise.sum(axis=1), further.sum(axis=1)
    aa = np.einsum("pn,pn->p", rise, rise) - first * first / count
    ab = np.einsum("pn,pn->p", rise, further) - first * second / count
    bb = np.einsum("pn,pn->p", further, further) - second * second / count
    ay, by, yy = rise @ y, further @ y, float(y @ y)
    tiny = np.finfo(float).tiny
    volume = np.maximum(aa * bb - ab * ab, tiny)
    a, b = (bb * ay - ab * by) / volume, (aa * by - ab * ay) / volume
    rises = (volume > _SINGULAR * aa * bb) & (a >= 0.0)
    rises &= power * a + (power + 1.0) * b * reach >= 0.0
    a = np.where(rises, a, np.maximum(ay / np.maximum(aa, tiny), 0.0))
    b = np.where(rises, b, 0.0)
    errors = yy - 2.0 * (a * ay + b * by) + a * a * aa + 2.0 * a * b * ab + b * b * bb
    return np.maximum(errors, 0.0), a, b


def _errors(d: Floats, f: Floats, places: Floats, power: float) -> Floats:
    rise, further = _columns(d, places, power)
    return _solved(rise, further, f, power, _reach(d, places))[0]


def _width(d: Floats, f: Floats, power: float, place: float, allowed: float) -> float:
    """Half the width of the places whose squared error stays below the allowed one."""
    low, high = float(d.min()), float(d[-1])
    near, far = place - low, high - place
    for _ in range(_ROUNDS):  # closer and closer around the best
        below, above = (
            np.linspace(place - near, place, _GRID),
            np.linspace(place, place + far, _GRID),
        )
        left = int(np.argmax(_errors(d, f, below, power) <= allowed))
        right = _GRID - 1 - int(np.argmax(_errors(d, f, above, power)[::-1] <= allowed))
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
