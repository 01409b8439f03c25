"""The page docs/wide_studies.md, from scored studies of the wide population."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import fill

from page import Origin
from registration import Registration

from qlvbayes.evaluation.counting import COUNTS, bound, is_right
from qlvbayes.evaluation.population import STRATA
from qlvbayes.evaluation.report import Report

_HEAD = """# Blind studies away from the paper's rig: {name}

{intro}

| | |
|---|---|
| registration | `validation/registered/{name}.json`: seed {seed}, {studies} studies |
| code, rules of the count | {code}, {rules} |
| command | `{command}` |
| date, commit | {date}, {commit} |
| machine | {machine} |
| studies | {done}, of which {seen} could be seen; {seconds} s for one (median) |
"""
_INTRO = """
The strata are crossed at random and every level of each comes equally often (of records, each
kind of disturbance in 8 % of the studies). Rig, law and
noise are the simulator's own: contact begins up to 0.02 mm below the start and within some um,
holds creep by less than half an encoder step, relaxation is a closed form carried by the
simulator's own modes, and where a frame yields the pad moves more slowly than the platen.
Effects are 0.5 to 15 % of the peak force. What *could be seen* follows from the simulator
alone. Rates are over those studies, with one-sided 95 % bounds (Clopper-Pearson). Seeds, code
and rules were committed before the run."""


def wide_page(report: Report, registered: Registration, origin: Origin) -> str:
    """Markdown."""
    head = _HEAD.format(
        intro=fill(" ".join(_INTRO.split()), 100), name=registered.name, seed=registered.seed,
        studies=registered.studies, code=registered.code, rules=registered.rules,
        command=origin.command,
        date=origin.date, commit=origin.commit, machine=origin.machine, done=len(report.cases),
        seen=sum(case["seen"] for case in report.cases),
        seconds="-" if report.seconds is None else f"{report.seconds:.0f}",
    )  # fmt: skip
    note = [fill(f"{registered.note} {_unfinished(report, registered)}".strip(), 100) + "\n"]
    return "\n".join([head, *note, *tables(report, registered.asked)])


def tables(report: Report, asked: Mapping[str, float]) -> list[str]:
    """Return the sections of a page: rates, strata, reliability and the wrong verdicts.

    Parameters
    ----------
    report
        Finished studies.
    asked
        Shares that are required of rates, by the name of the count.
    """
    return [_rates(report, asked), _strata(report), _reliability(report), _wrong(report)]


def _rates(report: Report, shares: Mapping[str, float]) -> str:
    lines = ["## Rates\n", "| hidden: verdict | asked | found | 95 % bound | n | |"]
    lines.append("|---|---|---|---|---|---|")
    for count in COUNTS:
        rate, asked = report.rate(count), shares.get(count.name)
        if rate.share is None:
            continue
        sign, most = (">", "at least") if count.good else ("<", "at most")
        limit = f"{sign} {100 * bound(rate, count.good):.1f} %"
        wanted, met = "-", ""
        if asked is not None:
            wanted = f"{most} {100 * asked:g} %"
            fine = rate.share >= asked if count.good else rate.share <= asked
            met = "met" if fine else "**not met**"
        row = f"{count.words} | {wanted} | {100 * rate.share:.1f} % | {limit} | {rate.n} | {met}"
        lines.append(f"| {row} |")
    return "\n".join([*lines, ""])


def _strata(report: Report) -> str:
    lines = [
        "## By stratum\n",
        "| stratum | level | studies | right | bound | wrong name | bound |",
    ]
    lines.append("|---|---|---|---|---|---|---|")
    for stratum, levels in report.by_level().items():
        for level, found in levels.items():
            shown = [_share(found[key], sign) for key, sign in (("right", ">"), ("wrong", "<"))]
            lines.append(f"| {stratum} | {level} | {found['studies']} | {' | '.join(shown)} |")
    return "\n".join([*lines, ""])


def _share(found: dict, sign: str) -> str:
    if not found["n"]:
        return "- | -"
    return f"{found['hits']}/{found['n']} | {sign} {100 * found['bound95']:.0f} %"


def _reliability(report: Report) -> str:
    intro = """Of every listed effect of every study, whether it could be seen or not: the stated
    probability of its being there against the share in which it is hidden (of another form: its
    family). What counts neither as wanted nor as wrong is left out. Behind each share its two-sided
    95 % bounds (Clopper-Pearson); probabilities that are right lie within them."""
    lines = ["## Stated probability of an effect against the share in which it is there\n"]
    lines += [fill(" ".join(intro.split()), 100, break_on_hyphens=False) + "\n"]
    lines += ["| probability | mean | there | n | not refused: mean | there | n |"]
    lines += ["|---|---|---|---|---|---|---|"]
    for row in report.reliability():
        shown = f"{_shown(row['all'])} | {_shown(row['kept'])}"
        lines.append(f"| {row['low']:.1f} to {row['high']:.1f} | {shown} |")
    return "\n".join([*lines, ""])


def _shown(found: dict) -> str:
    if not found["n"]:
        return "- | - | 0"
    low, high = (100 * limit for limit in found["bounds95"])
    share = f"{100 * found['share']:.0f} % ({low:.0f} to {high:.0f})"
    return f"{found['mean']:.3f} | {share} | {found['n']}"


def _wrong(report: Report) -> str:
    wrong = [case for case in report.cases if case["seen"] and not is_right(case)]
    lines = [f"## Wrong verdicts where the truth could be seen: {len(wrong)}\n"]
    keys = [key for key in STRATA if key != "kind"]
    lines += ["| study | hidden | verdict | named | group | strata |", "|---|---|---|---|---|---|"]
    for case in wrong:
        hidden, named, group = (" + ".join(case[k]) or "-" for k in ("names", "effects", "group"))
        strata = ", ".join(case["strata"][key] for key in keys)
        row = f"{case['index']} | {hidden} | {case['verdict']} | {named} | {group} | {strata}"
        lines.append(f"| {row} |")
    return "\n".join([*lines, ""])


def _unfinished(report: Report, registered: Registration) -> str:
    """Report that a run is not finished; nothing for one that is."""
    done = len(report.cases)
    if done == registered.studies:
        return ""
    return (
        f"Of the {registered.studies} registered studies {done} are finished: strata may lack the "
        "number that is asked for, and rates have wide bounds."
    )
