"""State in every exported file its model, units, date, tested range and limits."""

from __future__ import annotations

import re
from collections.abc import Iterable

from jinja2 import Environment, PackageLoader, StrictUndefined

import qlvbayes
from qlvbayes.io.wording import visible
from qlvbayes.use.exports.pad import ExportedPad, PosteriorInterval
from qlvbayes.use.exports.target import AbstractTarget

# solvers read ASCII only
_ASCII = str.maketrans(
    {"δ": "d", "−": "-", "Σ": "sum", "∫": "int", "θ": "theta", "²": "^2"} | {"³": "^3"}
)

_BOUND = 0.1  # of its upper end: where a share's lower end is less, it may as well be zero

_SIGNS = re.compile(r"\*(?=/)|/(?=\*)|-(?=-)")

NO_CONTACT = (
    "loss of contact: on fast unloading a loose pad leaves the platen, the material does not"
)
ONE_DRAW = "the posterior: one draw only, with the intervals above"


def card(pad: ExportedPad, target: type[AbstractTarget], extra: Iterable[str] = ()) -> list[str]:
    """Return the lines, without comment signs; ``extra``: what else is not represented."""
    lines = [
        f"Pad {pad.pad}, by qlvbayes {qlvbayes.__version__} on {pad.date}"
        + (f", from {pad.origin}" if pad.origin else ""),
        f"Elastic law: {type(pad.elastic).name}, {type(pad.elastic).law}",
        f"Relaxation: {_relaxation(pad)}",
        *(
            f"Effect {x.name}: {x.formula}"
            for x in pad.pieces
            if target.steps and x.name in pad.effects
        ),
        f"Units: {_units(pad)}",
        f"Tested: {_tested(pad)}",
        "Median and 90 % interval:",
        *(_interval_line(x) for x in pad.intervals),
        "Numbers below: the posterior draw closest to the medians",
    ]
    lines += _long_term(pad)
    if not pad.converged:
        lines.append("Beware: the sampling had NOT CONVERGED")
    if pad.lacking:
        lines.append("Beware: by the diagnosis, more is there than this model")
    lost = (*_effects(pad, target), *target.cannot, *extra)
    lines.append("Not represented:" if lost else "Not represented: nothing of the fitted model")
    lines += [f"  - {line}" for line in lost]
    return [visible(" ".join(line.translate(_ASCII).split("\n"))) for line in lines]


def commented(lines: Iterable[str], sign: str) -> str:
    """Return the lines in ASCII, each behind a comment sign."""
    text = "\n".join(f"{sign} {line}".rstrip() for line in lines) + "\n"
    return text.encode("ascii", "backslashreplace").decode()


def in_comment(lines: Iterable[str]) -> list[str]:
    """Return the lines where no comment of C or XML begins anew, or ends before its time."""
    return [_SIGNS.sub(r"\g<0> ", line) for line in lines]


def template(file: str, /, **values: object) -> str:
    """Return a file of ``templates/`` filled in."""
    environment = Environment(
        loader=PackageLoader("qlvbayes.use.exports"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=file.endswith((".xml.j2", ".sdf.j2", ".feb.j2")),
    )
    environment.filters["in_comment"] = lambda text: in_comment([text])[0]
    return environment.get_template(file).render(**values)


def _interval_line(x: PosteriorInterval) -> str:
    unit = "" if x.unit == "1" else f" {x.unit}"
    return f"  {x.name} = {x.median:.6g} ({x.low:.6g} to {x.high:.6g}){unit}"


def _units(pad: ExportedPad) -> str:
    u = pad.units
    length = "none (strain)" if u.dimensionless else u.displacement
    return f"{u.displacement_name} {length}, {u.force_name} {u.force}, time s"


def _tested(pad: ExportedPad) -> str:
    reach, units = pad.covered, pad.units
    if reach is None:
        return "the results file does not say which depths, rates and times"
    unit = "" if units.dimensionless else f" {units.displacement}"
    return (
        f"depth to {reach.depth:.4g}{unit}, rate {reach.slowest:.4g} to {reach.fastest:.4g} "
        f"{units.speed.replace('1/s', '/s')}, ramps from {reach.quickest:.3g} s, holds to "
        f"{reach.hold:.4g} s, {reach.tests} tests; beyond that it extrapolates"
    )


def _relaxation(pad: ExportedPad) -> str:
    gone = {*pad.effects, *pad.left_out}
    within = [name for name in pad.choices.effects if name not in gone]
    if within:  # they are in the spectrum
        return f"{pad.choices.relaxing} with {' and '.join(within)}"
    return f"{pad.choices.relaxing}, {type(pad.relaxation).law}"


def _effects(pad: ExportedPad, target: type[AbstractTarget]) -> list[str]:
    """Return those that are not represented, each with the reason; and why there is no way back."""
    lost = pad.left_out if target.steps else dict.fromkeys(pad.effects, target.without_steps)
    lines = [f"the added effect {name}: {why}" for name, why in {**pad.left_out, **lost}.items()]
    if target.steps and pad.one_way:
        lines.append(f"displacement from force: {pad.one_way}")
    return lines


def _long_term(pad: ExportedPad) -> list[str]:
    """Return whether what never relaxes is known, or only how little of it there may be."""
    share = next((x for x in pad.intervals if x.name == "c[0]"), None)
    if share is None or share.low > _BOUND * share.high:
        return []
    held = "" if pad.covered is None else f" within the {pad.covered.hold:.3g} s that were held"
    return [
        f"Beware: the long-term modulus is NOT DETERMINED: c[0], {share.low:.2g} to "
        f"{share.high:.2g}, has an upper bound alone{held}; ratios to it have no meaning"
    ]
