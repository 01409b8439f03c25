"""Summarise fits in numbers: ``summary.json``, and the constants of all pads as CSV and LaTeX.

Constants that a prior pulls are told.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, log
from pathlib import Path

import numpy as np
from scipy.special import ndtri

from qlvbayes.fitting.ensemble import Diagnostics, Settings, highest_density
from qlvbayes.io.arrays import finite_or_none
from qlvbayes.io.checks import InputError
from qlvbayes.io.files import Part, Result, write_whole
from qlvbayes.io.units import PAD, UnitSystem
from qlvbayes.io.wording import as_cells, as_typed, plain, tex, with_ends
from qlvbayes.model.choices import Choices
from qlvbayes.model.drawn import lasting_share
from qlvbayes.model.overrides import parse_prior
from qlvbayes.priors import AbstractPrior, HalfNormal, LogNormal, LogUniform, Normal, Uniform

_COLUMNS = ["pad", "parameter", "value", "unit"]
_HEADS = "pad,parameter,unit,median,low90,high90,reference"
_FAR = 2.5  # sds of a normal prior: in 1.2 % of pads an estimate lies further out if it is right
_INDEXED = re.compile(r"([a-z])\[(\d+)\]")


class Constant(Part, frozen=True):
    """The posterior of one constant: mean, sd, median, 90 % highest-density interval, diagnostics.

    r_hat, ess_bulk: None where there is no chain.
    """

    unit: str
    mean: float
    sd: float
    median: float
    hdi90: tuple[float, float]
    r_hat: float | None
    ess_bulk: float | None

    @property
    def fixed(self) -> bool:
        """Return whether the constant was not fitted."""
        return self.sd == 0.0


class FitSummary(Result, frozen=True, kw_only=True):
    """Posterior of every constant of one pad, and whether its sampling converged: ``summary.json``.

    pad: Name of the pad; units: Units of displacement and force, from which those of the constants
    follow; effects: Names of the model's effects; sampler: Method of the fit: ``emcee``,
    ``least-squares`` or ``two-step``; converged: Whether no R-hat, effective sample size or
    autocorrelation time speaks against the sampling; of least squares, whether two starts came to
    the same optimum; troubles: Messages on what speaks against it; empty where ``converged`` is
    true; notices: Sentences on the tests and their noise, such as what the tests cannot determine;
    settings: Settings of the sampler, of which least squares use the seed alone; None where not
    stated; never_relaxes: Share of the force that never relaxes, of the whole model with its
    effects; None where it depends on depth, or is not stated; parameters: Posterior of
    each constant by its name, as ``m`` or ``v[1]``, in the constant's own unit.
    """

    pad: str
    units: UnitSystem = PAD
    effects: tuple[str, ...]
    sampler: str
    converged: bool
    troubles: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()
    settings: Settings | None = None
    never_relaxes: Constant | None = None
    parameters: dict[str, Constant]

    def __getitem__(self, name: str) -> Constant:
        """Return the constant of a name."""
        return self.parameters[name]

    def __str__(self) -> str:
        """Return a line for each constant: median, 90 % interval and unit."""
        wide = max(map(len, self.parameters), default=0)
        lines = [
            f"{name:{wide}}  {'{} [{}, {}]'.format(*with_ends(c.median, *c.hdi90))}"
            f"{'' if c.unit == '1' else f' {c.unit}'}{' (fixed)' if c.fixed else ''}"
            for name, c in self.parameters.items()
        ]
        return "\n".join([*lines, *(f"not converged: {text}" for text in self.troubles)])


def constant_of(
    values: np.ndarray, unit: str, index: int, diagnostics: Diagnostics | None
) -> Constant:
    """Return the summary of draws (chains, draws) of one constant."""
    # a fixed constant keeps its exact value, and has an sd of exactly 0
    varies = np.ptp(values) > 0.0
    mean, sd = (values.mean(), values.std()) if varies else (values.flat[0], 0.0)
    r_hat = finite_or_none(diagnostics.r_hat[index]) if diagnostics else None
    ess = finite_or_none(diagnostics.ess_bulk[index]) if diagnostics else None
    median, interval = float(np.median(values)), highest_density(values)
    return Constant(unit, float(mean), float(sd), median, interval, r_hat, ess)


def lasting_of(choices: Choices, names: Sequence[str], draws: np.ndarray) -> Constant | None:
    """Return the share of the force that never relaxes, of draws (chains, draws, P), in summary."""
    share = lasting_share(choices, names, draws.reshape(-1, len(names)))
    return None if share is None else constant_of(share[None], "1", 0, None)


@dataclass(frozen=True)
class Reference:
    """A value of a constant from elsewhere, with its unit."""

    value: float
    unit: str


@dataclass(frozen=True)
class Entry:
    """A constant of one pad: median, 90 % interval, and the reference value if there is one."""

    pad: str
    parameter: str
    unit: str
    median: float
    low: float
    high: float
    reference: float | None = None


References = Mapping[tuple[str, str], Reference]


def read_references(path: str | Path) -> dict[tuple[str, str], Reference]:
    """Read reference values by pad and parameter from a CSV file: ``pad,parameter,value,unit``."""
    file, columns = Path(path), ",".join(_COLUMNS)
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        remedy = f"name a CSV file with the columns {columns}"
        raise InputError("these references cannot be read", file=file, remedy=remedy) from error
    rows = [(k, line) for k, line in enumerate(lines, 1) if line.strip() and line[0] != "#"]
    parsed = [[cell.strip() for cell in row] for row in csv.reader([line for _, line in rows])]
    if not parsed or parsed[0] != _COLUMNS:
        line, remedy = rows[0][0] if rows else None, f"begin with the line {columns}"
        raise InputError("not a table of references", file=file, line=line, remedy=remedy)
    references: dict[tuple[str, str], Reference] = {}
    for (number, _), cells in zip(rows[1:], parsed[1:], strict=True):
        fault = None
        try:
            pad, parameter, text, unit = cells
            value = float(text)
        except ValueError:
            value, text = float("nan"), cells[2] if len(cells) > 2 else ""
        if len(cells) != len(_COLUMNS):
            fault = f"{len(cells)} columns, not 4", f"write {columns}"
        elif not isfinite(value):
            fault = f"value is not a number ('{text}')", "write a number or delete the row"
        elif (pad, parameter) in references:
            fault = f"{parameter} of pad {pad} again", "delete one of them"
        if fault:
            raise InputError(fault[0], file=file, line=number, remedy=fault[1])
        references[pad, parameter] = Reference(value, unit)
    return references


def matching_references(references: References, summaries: Iterable[FitSummary]) -> References:
    """Return the references that are in the constant's unit; another law may have another one."""
    units = {(s.pad, name): c.unit for s in summaries for name, c in s.parameters.items()}
    return {key: one for key, one in references.items() if units.get(key) in (None, one.unit)}


def constants_table(
    summaries: Iterable[FitSummary], references: References | None = None
) -> list[Entry]:
    """Return the entries of every constant, pad by pad; InputError on a reference's other unit."""
    entries = []
    for pad, name, c in ((s.pad, n, c) for s in summaries for n, c in s.parameters.items()):
        known = (references or {}).get((pad, name))
        if known is not None and known.unit != c.unit:
            what = f"the reference of {name} of pad {pad} is in {known.unit or 'no unit'}"
            raise InputError(what, remedy=f"give it in {c.unit}")
        value = None if known is None else known.value
        entries.append(Entry(pad, name, c.unit, c.median, *c.hdi90, value))
    return entries


def as_csv(entries: Sequence[Entry]) -> str:
    """Return the table as CSV: one row for each constant of a pad."""
    file = io.StringIO()
    table = csv.writer(file, lineterminator="\n")
    table.writerow(_HEADS.split(","))
    for e in entries:
        cells = [f"{x:.6g}" for x in (e.median, e.low, e.high)]
        cells += ["" if e.reference is None else f"{e.reference:.6g}"]
        table.writerow([*as_cells([e.pad, e.parameter, e.unit]), *cells])
    return file.getvalue()


def as_latex(entries: Sequence[Entry]) -> str:
    """Return the table for LaTeX's booktabs: constants in rows, pads and references in columns."""
    shown = [e for e in entries if not e.parameter.startswith("noise.")]
    pads = list(dict.fromkeys(e.pad for e in shown))
    known = {e.pad for e in shown if e.reference is not None}
    heads = [f"pad {tex(pad)}{' & reference' if pad in known else ''}" for pad in pads]
    entry_of = {(e.pad, e.parameter, e.unit): e for e in shown}
    # pads in other units, or of other laws, have a row of their own
    rows = [
        [symbol(name), "" if unit == "1" else tex(unit)]
        + [cell for pad in pads for cell in _cells(entry_of.get((pad, name, unit)), pad in known)]
        for name, unit in dict.fromkeys((e.parameter, e.unit) for e in shown)
    ]
    lines = [
        "% needs \\usepackage{booktabs}; median [90 \\% highest-density interval]",
        f"\\begin{{tabular}}{{ll{''.join('lr' if pad in known else 'l' for pad in pads)}}}",
        "\\toprule",
        " & ".join(["constant", "unit", *heads]) + " \\\\",
        "\\midrule",
        *(" & ".join(row) + " \\\\" for row in rows),
        "\\bottomrule",
        "\\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def write_constants(out: Path, entries: Sequence[Entry], *, for_print: bool = True) -> list[Path]:
    """Write ``out``/constants.csv, and .tex with a column a pad, completely or not at all."""
    texts = {"csv": as_csv(entries)}
    if for_print:
        texts["tex"] = as_latex(entries)
    for suffix, text in texts.items():
        write_whole(out / f"constants.{suffix}", text.encode())
    return [out / f"constants.{suffix}" for suffix in texts]


def symbol(name: str) -> str:
    """Return a constant's name in mathematical notation: '$c_0$' for 'c[0]'; others unchanged."""
    match = _INDEXED.fullmatch(name)
    if match:
        return f"${match[1]}_{match[2]}$"
    return f"${name}$" if len(name) == 1 else tex(name)


def _cells(entry: Entry | None, with_reference: bool) -> list[str]:
    """Return the cells of one constant of one pad, with its reference if there is a column."""
    if entry is None:
        return ["--", "--"] if with_reference else ["--"]
    texts = with_ends(entry.median, entry.low, entry.high)
    median, low, high = (text.replace("-", "$-$") for text in texts)
    fixed = entry.low == entry.high
    cells = [f"{median} (fixed)" if fixed else f"{median} [{low}, {high}]"]
    if with_reference:
        cells.append("--" if entry.reference is None else f"{entry.reference:g}")
    return cells


def pulled(summary: FitSummary, priors: dict[str, str]) -> tuple[str, ...]:
    r"""Return a sentence on each constant whose posterior median lies far out of its prior.

    The median x lies z scales out, where :math:`\Phi(z)` is the prior's probability below x; of a
    half-normal prior, z = x/sd. ``priors`` are those of ``posterior.nc``, as on the command line.
    """
    texts = {
        name if name in summary.parameters else f"{name}[{k}]": one
        for name, text in priors.items()
        for k, one in enumerate(text.split(" > "), 1)  # rates fall: v[1] > v[2]
    }
    found = []
    for name, text in texts.items():
        constant = summary.parameters.get(name)
        try:
            prior = parse_prior(text)
        except InputError:  # fixed, not sampled, or a user's own
            continue
        if constant is None or constant.fixed:
            continue
        out, wider = _scales_out(prior, constant.median)
        if abs(out) > _FAR:
            found.append(
                f"{name}: the estimate lies {plain(abs(out), 2)} prior scales out, and the prior "
                f"{text} pulls it {'down' if out > 0.0 else 'up'}; a wider one: "
                f"{as_typed('--prior', f'{name}={wider}')}"
            )
    return tuple(found)


def _scales_out(prior: AbstractPrior, value: float) -> tuple[float, str]:
    """Return how many scales a value lies out of its prior, and a prior in which it lies one out.

    Bounds become wider by their distance, or tenfold where the prior is of a logarithm.
    """
    match prior:
        case HalfNormal(sd=sd):
            return value / sd, f"halfnormal({plain(value, 2)})"
        case Normal(mean=mean, sd=sd):
            return (value - mean) / sd, f"normal({mean:g},{plain(abs(value - mean), 2)})"
        case LogNormal(log_median=middle, log_sd=sd):
            off = log(value) - middle
            return off / sd, f"lognormal({middle:g},{plain(abs(off), 2)})"
        case Uniform(low=low, high=high):
            reach, below = high - low, (value - low) / (high - low)
            lower = max(low - reach, min(low, 0.0)) if below < 0.5 else low
            return ndtri(below), f"uniform({lower:g},{high + reach * (below > 0.5):g})"
        case LogUniform(low=low, high=high):
            below = log(value / low) / log(high / low)
            ends = (low / 10.0, high) if below < 0.5 else (low, 10.0 * high)
            return ndtri(below), "loguniform({:g},{:g})".format(*ends)
    return 0.0, ""
