"""The page docs/blind_studies.md, from scored studies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from textwrap import fill

from levels import Level, levels
from page import Origin

from qlvbayes.evaluation.case import DECISIVE
from qlvbayes.evaluation.detect import SEEN
from qlvbayes.evaluation.plan import KINDS
from qlvbayes.evaluation.report import Report
from qlvbayes.evaluation.scores import (
    LARGEST_GROUP,
    QUESTIONS,
    is_left_open,
    is_right_or_grouped,
    is_unexplained,
    names_family,
)
from qlvbayes.evaluation.study import NOISE_FACTOR, NOISE_TIME, RETRACTIONS, ROWS, SIZES

_MOST_MISSES = 60  # listed one by one, at most

_HEAD = """# Blind studies: does the diagnosis find what is hidden?

Pads were simulated by differential equations that share no code with the fit, with constants drawn
at random and an effect hidden in them, drawn at random too, or none. The diagnosis saw six tests a
pad and nothing else. Of 20 pads {kinds}.

An effect's largest contribution to the force is log-uniform between {sizes} of the peak force. Half
of the pads are tested by the paper's protocol, half with {retractions} of the six tests back to
zero twice; {rows} rows a test, {noise} noise whose sds are up to a factor {factor:g} off the
paper's either way, with correlation times of {time[0]:g} to {time[1]:g} s.

An effect *could be seen* where the simulator's own forces, projected off what the constants can
take, promise 2 ln(Bayes factor) > {seen:g}; the diagnosis plays no part in that.

{verdict}

| | |
|---|---|
| command | `{command}` |
| date | {date} |
| commit | {commit} |
| digest of the code that ran the studies | {digest} |
| machine | {machine} |
| studies | {studies}, of which {visible} could be seen (nothing hidden: all count) |
| time | {seconds} s for a diagnosis (median) |
"""

_LIMITS = """What can be had of single effects that could be seen: noise alone keeps some below the
log Bayes factor of {least:.2g} from which an effect is named, and a diagnosis that never errs would
name {share:.1f} %. Naming whatever is ranked first would be right in {promised:.1f} %, by the
probabilities' own promise."""

_NOTES = """## How to read it

- Standard errors are binomial, of the share seen, shrunk off 0 and 1. *In doubt*: a bound is within
  two standard errors of the figure.
- *named* means named without a rival and with nothing besides. *Left open*: the truth is named, or
  in the group of an `ambiguous` verdict, or among the sets of effects that the diagnosis lists as
  not ruled out (`not_ruled_out` in diagnosis.json: the likeliest {group}); {open} such had the
  verdict `adequate`, where one of the sets is that nothing is missing.
- *calibration error*: of the probability of the first-ranked hypothesis, nothing or one effect
  hidden, ten bins, all studies. Probabilities that are exactly right would show {chance} on as
  many, by chance.
- Constants are averaged over all hypotheses on the same laws, by their probability.
- A program that stopped with an error counts as a wrong verdict.
- The diagnosis and its thresholds were made with studies of seeds 1 to 7, 11 and 21 to 38, and with
  pads of seeds 101 to 109 that lack nothing. Those of any other seed are pads that it had never
  met, of kinds that it had: its own forms of some effects were written with these forms in view.
- Where the hidden effect is an extra relaxation mode, the fit may call one of the pad's own modes
  the extra one; the true constants are then taken under the fit's names.
- Noise is normal here and contact loose; the law beneath the effects is the fitted one.
"""


def blind_page(report: Report, origin: Origin, picture: str, note: str = "") -> str:
    """Markdown."""
    rows = levels(report)
    parts = [
        _wrapped(_head(report, rows, origin)),
        *([fill(note, 100) + "\n"] if note else []),
        _levels_table(rows),
        f"![confusion matrix, reliability, errors on left-out tests]({picture})\n",
        _rates_table(report),
        _constants_table(report),
        _misses(report),
        _NOTES.format(
            group=LARGEST_GROUP,
            chance=_by_chance(report),
            open=_open_and_adequate(report),
        ),
    ]
    return "\n".join(parts)


def _head(report: Report, rows: Sequence[Level], origin: Origin) -> str:
    words = {"none": "nothing", "single": "one effect of the list", "double": "two of the list"}
    words |= {"form": "another form of one", "outside": "something outside the list"}
    return _HEAD.format(
        kinds=", ".join(f"{n} hide {words[kind]}" for kind, n in KINDS.items()),
        sizes=f"{_range(SIZES['single'])} (two effects {_range(SIZES['double'])} each, outside the "
        f"list {_range(SIZES['outside'])})",
        retractions=RETRACTIONS, rows=ROWS, noise=report.plan.noise, factor=NOISE_FACTOR,
        time=NOISE_TIME, seen=SEEN, verdict=_verdict(rows), command=origin.command,
        date=origin.date, commit=origin.commit, digest=_codes(report), machine=origin.machine,
        studies=len(report.cases), visible=sum(case["seen"] for case in report.cases),
        seconds="-" if report.seconds is None else f"{report.seconds:.1f}",
    )  # fmt: skip


def _by_chance(report: Report) -> str:
    found = report.reliability.by_chance
    return "-" if found is None else f"{found:.3f}"


def _open_and_adequate(report: Report) -> int:
    """Single effects that could be seen and are left open by a verdict that names nothing."""
    single = [c for c in report.cases if c["seen"] and c["kind"] == "single"]
    return sum(c["verdict"] == "adequate" and is_left_open(c) for c in single)


def _codes(report: Report) -> str:
    count = Counter(case["code"] for case in report.cases)
    if len(count) == 1:
        return next(iter(count))
    return ", ".join(f"{code} ({n} studies)" for code, n in count.most_common())


def _wrapped(text: str) -> str:
    """Paragraphs in lines of at most 100; tables and headings as they are."""
    blocks = text.split("\n\n")
    return "\n\n".join(b if b.startswith(("#", "|")) else fill(b, 100) for b in blocks)


def _range(bounds: tuple[float, float]) -> str:
    return f"{100 * bounds[0]:g} and {100 * bounds[1]:g} %"


def _verdict(rows: Sequence[Level]) -> str:
    missed = [f"{row.words} ({row.shown}; asked: {row.asked})" for row in rows if not row.met]
    if not missed:
        return "**Result: every required level is met.**"
    return f"**Result: {len(missed)} of {len(rows)} levels are not met: {'; '.join(missed)}.**"


def _levels_table(rows: Sequence[Level]) -> str:
    lines = ["## Required levels\n", "| | asked | found | n | |", "|---|---|---|---|---|"]
    for row in rows:
        verdict = "met" if row.met else "**not met**"
        verdict += ", in doubt" if row.in_doubt else ""
        lines.append(f"| {row.words} | {row.asked} | {row.shown} | {row.n} | {verdict} |")
    return "\n".join([*lines, ""])


def _rates_table(report: Report) -> str:
    lines = ["## All rates\n", "| hidden: verdict | could be seen | n | all | n |"]
    lines.append("|---|---|---|---|---|")
    for question in QUESTIONS:
        seen, every = (report.rates[question.name][which] for which in ("seen", "all"))
        lines.append(f"| {question.words} | {seen} | {seen.n} | {every} | {every.n} |")
    lines += _limits(report)
    lines += ["", "Error on left-out tests over the noise floor (median):\n"]
    lines += ["| hidden | plain model | last model | n |", "|---|---|---|---|"]
    for kind, found in report.heldout.items():
        if found["plain"] is not None:
            row = f"{found['plain']:.2f} | {found['final']:.2f} | {found['n']}"
            lines.append(f"| {kind} | {row} |")
    return "\n".join([*lines, ""])


def _limits(report: Report) -> list[str]:
    if report.ceiling is None or report.promised is None:
        return []
    shares = {"share": 100.0 * report.ceiling, "promised": 100.0 * report.promised}
    return ["", _LIMITS.format(least=DECISIVE, **shares)]


def _constants_table(report: Report) -> str:
    lines = ["## Constants of the pad, one effect that could be seen\n"]
    lines.append("| constant | in 90 %, plain | in 90 %, last model | error/sd, plain | last |")
    lines.append("|---|---|---|---|---|")
    for c in report.constants.values():
        row = f"{c.before} | {c.after} | {c.off_before:.1f} | {c.off_after:.1f}"
        lines.append(f"| {c.name} | {row} |")
    return "\n".join([*lines, ""])


def _misses(report: Report) -> str:
    """What could be seen and got a verdict without the truth in it."""
    right = {"form": names_family, "outside": is_unexplained}
    wrong = [
        case
        for case in report.cases
        if case["seen"] and not right.get(case["kind"], is_right_or_grouped)(case)
    ]
    lines = [f"## Wrong verdicts where the truth could be seen: {len(wrong)}\n"]
    lines += ["| study | hidden | verdict | named | rivals |", "|---|---|---|---|---|"]
    for case in wrong[:_MOST_MISSES]:
        hidden, named, rivals = (
            " + ".join(case[key]) or "nothing" for key in ("names", "effects", "group")
        )
        lines.append(f"| {case['index']} | {hidden} | {case['verdict']} | {named} | {rivals} |")
    if len(wrong) > _MOST_MISSES:
        lines.append(f"\nand {len(wrong) - _MOST_MISSES} more.")
    return "\n".join([*lines, ""])
