"""Write docs/reliability.md, the page with all rates, from validation/results.

Numbers stand in the tables alone: the text says what was counted and how to read it.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from textwrap import fill

from blind.constants import coverage
from blind.counting import COUNTS, Count, Rate, bound
from certainty import confirmed_cases, diagnosed, names_of, of_certainty
from registration import ASKED, Registration
from results import RESULTS, ROOT, Table, grid, share
from runs import Run, rates_of, read_cases, read_runs

from qlvbayes.diagnosis.certainty import LEAST, calibration
from qlvbayes.io.files import write_whole

PAGE = ROOT / "docs" / "reliability.md"
HOME, AWAY = "rig", "support"
"""The runs that count the present program, on the paper's rig and on others."""
_SURE = 0.8  # certainty from which the first paragraph counts
_IN_TABLE = (
    "right", "wrong", "none_adequate", "single_named", "double_named", "form_kin", "outside_open",
    "beside_named", "failed",
)  # fmt: skip


def in_short() -> str:
    """Return in one paragraph what may be believed, with the rates that say so."""
    runs = read_runs()
    home, away = runs[HOME].rates, runs[AWAY].rates
    known = calibration()
    stated = [(known(name.x), name.there) for name in names_of(HOME, diagnosed(HOME))]
    there = [there for value, there in stated if value is not None and value >= _SURE]
    sure = _counted(Rate(sum(there), len(there)))
    text = f"""
A name that the diagnosis gives may be believed about as far as its certainty says: on the paper's
rig effects with a certainty of {_SURE} or more were there in {sure}.
Where nothing is missing an effect was named in {_counted(home["false_name"])} of the pads there and
in {_counted(away["false_name"])} on other rigs. That nothing is named does not say that
nothing is missing. One effect that the tests can show was named in {_counted(home["single_named"])}
on the paper's rig and {_counted(away["single_named"])} on others, two in
{_counted(home["double_named"])} and {_counted(away["double_named"])}, and fewer on pads that
differ from test to test ([lifelike pads](#lifelike-pads)). What no list holds was told as such in
{_counted(home["outside_open"])} and {_counted(away["outside_open"])}; in the others a listed effect
that resembles it got part of the blame. Look at the error on tests left out: a name that does not
lower it explains nothing."""
    return fill(text.replace("\n", " ").strip(), 100)


def rates() -> str:
    """Return the rates of the two runs that count, with bounds, beside what is asked."""
    runs = read_runs()
    home, away, now = runs[HOME].rates, runs[AWAY].rates, rates_of(confirmed_cases(AWAY))
    asked = Registration.read(AWAY).asked
    head = [
        "hidden: verdict", f"the paper's rig ({HOME})", "bound", "asked",
        f"other rigs ({AWAY})", "bound", "asked", f"{AWAY}, sure names only",
    ]  # fmt: skip
    table = [
        [
            count.words, *_found(count, home[count.name], ASKED["paper"]),
            *_found(count, away[count.name], asked), _counted(now[count.name]),
        ]
        for count in COUNTS
    ]  # fmt: skip
    return "\n".join(grid(head, table))


def _found(count: Count, rate: Rate, asked: dict[str, float]) -> list[str]:
    limit = f"{'>' if count.good else '<'} {bound(rate, count.good):.0%}" if rate.n else "-"
    wanted = asked.get(count.name)
    words = "-" if wanted is None else f"{'at least' if count.good else 'at most'} {wanted:.0%}"
    return [_counted(rate), limit, words]


def _counted(rate: Rate) -> str:
    return share(rate.hits, rate.n)


def every_run() -> str:
    """Return a line for every run whose verdicts were all counted."""
    head = ["run (seed)", "rig", "date, commit", "what was new", "finished", "could be seen"]
    words = {count.name: count.words for count in COUNTS}
    table = [_line(run) for run in read_runs().values() if run.rates["right"].n]
    return "\n".join(grid([*head, *(words[name] for name in _IN_TABLE)], table))


def _line(run: Run) -> list[str]:
    facts = [f"{run.run} ({run.seed})", run.rig, f"{run.date}, {run.commit}", run.new]
    sizes = [f"{run.finished} of {run.registered}", str(run.seen)]
    counts = [run.rates[name] for name in _IN_TABLE]
    return [*facts, *sizes, *(f"{rate.hits} of {rate.n}" if rate.n else "-" for rate in counts)]


def constants() -> str:
    """Return how often 90 % intervals contain the truth, without the hidden effect and with it."""
    head = ["constant", "in the model without effects", "in the model of the answer"]
    table = [
        [name, *(f"{rate.hits} of {rate.n}" for rate in (found.before, found.after))]
        for name, found in coverage(read_cases(HOME)).items()
    ]
    return "\n".join(grid(head, table))


PARTS: tuple[tuple[str, Callable[[], str]], ...] = (
    (
        """# How far to trust it

All rates of the package stand on this page. It is generated by `validation/reliability.py` from
`validation/results/`, where each run has left its table with its command, date and commit.
`make validate` repeats the counts at sizes that fit into two hours, `make validate FULL=1` at the
sizes shown here. What the program cannot do is said in [limits](limits.md).
""",
        in_short,
    ),
    (
        """
## Naming what is missing

Pads are simulated by differential equations that share no code with the fit, and diagnosed blind.
Equally many hide nothing, one candidate effect, two, another form of one, something unlisted, or
that together with a candidate. Effects are 0.5 to 15 % of the peak force. Seed, code and rules of
the count were committed before each registered run, and what was finished counts (of *rig* up to
the first study that was not). Only those studies count in which the simulator's own forces show
what is hidden. Bounds are one-sided 95 % bounds (Clopper and Pearson).

*The paper's rig* has the paper's laws and programme and correlated noise. *Other rigs* cross other
protocols, laws, histories, load cells and loggers at random, and 8 % each of the studies have lost
readings, late starts, unequal holds, changing noise or holds under a force. *Sure names only* is
the rule by which `diagnose` decides now, on the searches of that run: names are those of a
probability of 0.9 and a certainty of 0.6, each certainty learnt on the other studies. With it,
studies in which the program stopped are left out. The rates of *rig* and *support* are those of
the decision before it, which also refused effects whose strength would have to vary.
""",
        rates,
    ),
    (
        """
### How much could be told at all

An observer who knows every mechanism that the simulator has, the laws, the noise and the motion,
and no constant, sees a hidden mechanism if its expected evidence exceeds that of its constants
(`validation/ceiling.py`). It could be *told* if that is so while everything else that is hidden
counts as an error of its own shape and true size. Whether something else would imitate it is not
asked, so that the share is an upper bound.
""",
        lambda: Table.read("ceiling").markdown(),
    ),
    (
        """
### Would another evidence decide better?

Studies of *support* are searched once more, and the modes that were found are evaluated again
(`validation/experiments.py`): with other weights of the candidates' signatures in the discrepancy;
with sets of up to five effects that a joint sparse choice over all effects proposes; and with three
states of an effect, present, mimicked (another strength in each test) or absent. Each answers by
probabilities alone, without support and certainty. Studies, code and rules were committed before. A
variant was to be adopted if its log loss is lower by more than two standard errors, without more
wrong names.
""",
        lambda: Table.read("experiments").markdown(),
    ),
    (
        """
90 % intervals of the constants that contain the truth, where on the paper's rig one effect is
hidden and can be seen, and the laws of the answer are the pad's:
""",
        constants,
    ),
    (
        """
### Lifelike pads

Pads as in a laboratory: always something unlisted of 0.3 to 3 % of the peak force, strengths and
stiffness that differ from test to test, jerk-limited motion, one contact with an error, noise of
0.02 to 1 % of the peak (`validation/lifelike.py`). Seed and count were committed before the run.
The certainty was learnt on the runs above, not on these pads; the notes below the table say how it
holds here, and which effects are missed. Asked for were 80 % of single effects named and 5 % of
studies with a wrong name. The code changed within the run. What its cases showed was mended after
it and is not in the counts: masses at starts that readings do not resolve, constants at their
bounds, and the study that stopped.
""",
        lambda: Table.read("lifelike").markdown(),
    ),
    (
        """
### Described laws

Pads on two rigs with a mechanism that no list holds, of 2 to 8 % of the peak force after the
constants have taken what they can, with a listed effect, or with nothing hidden
(`validation/described.py`). A law counts where it predicts *fresh* tests of the same pad, at speeds
and depths that are not in the record: it halves their error, or makes it worse (by more than 2 %).
Seed and count were committed before the run. Asked for were 60 % halved, 5 % worse, and a law for
at most 5 % of the pads that hold nothing or a listed effect. The fresh tests come after all others,
so that a law that follows the clock or the number of loadings is carried on beyond the record: one
of these (*slow swelling*) did the largest harm. Heat, swelling and a warming drive are what terms
of the grammar can follow, and these were halved; for a rolling specimen, a cracking skin or a pad
that hardens no terms predicted tests left out, and in others a listed effect took the blame.
""",
        lambda: Table.read("described").markdown(),
    ),
    (
        f"""
### Certainty

`certainty` in `diagnosis.json` corrects the posterior probability of an effect by what happened in
a run of blind studies: it is a logistic regression on what speaks for and against a name, learnt by
`validation/certainty.py`. Counted are effects with a posterior probability of {LEAST:.0%} or more.
In the run that it was learnt on, each study's names have the certainty that the other nine tenths
of the studies give.
""",
        lambda: of_certainty(AWAY, HOME),
    ),
    (
        """
### A first guess

`look --cause` fits the plain model once and says which effects are likely missing, by logistic
regressions that `validation/learn_guess.py` learns from the studies of *support* that are simulated
soonest and from lifelike pads. Each pad is guessed by what the other four fifths of the pads teach.
*Prior rates*: the log loss (nats) of stating how often each is hidden; *other programmes*: of what
pads of other programmes of the platen teach, over the pads that are near enough to those for a
guess. Seed, number of pads and rules of the count were committed before; pads with which the
features were chosen are not counted. Effects that are hidden in none of the counted pads are left
out. The pads are few, so that little is known of single effects.
""",
        lambda: Table.read("guess").markdown(),
    ),
    (
        """
How often it is so, by the probability that the guess states:
""",
        lambda: Table.read("guess_bins").markdown(),
    ),
    (
        """
### Every run

A run that is smaller than registered was stopped for the next version, and small ones tell little.
*Wide* rigs are other ones than the paper's. Each run is counted by the rules of its time. A run
named *repeated* is the first studies of *rig* by a later commit. `rates.csv` has all counts, and
two first runs on the paper's rig, of which only some were kept.
""",
        every_run,
    ),
    (
        """
## Intervals of the constants

Pads are drawn at random, simulated with the paper's protocol, and one test of each, at 20 mm/s, is
fitted by `fit` with its default settings; the other tests are predicted. A 90 % interval should
contain the truth nine times out of ten. *z* is the posterior mean less the truth over the posterior
sd: its mean should be 0 and its sd 1. *Width* is the median width of the interval over the true
value. The priors are not the distribution that the constants are drawn from, so that exactly 90 %
is not to be expected.
""",
        lambda: Table.read("coverage").markdown(),
    ),
    (
        """
**Calibrated by simulation.** Here constants and noise are drawn from the very priors that the fit
is given, with noise of about a tenth of the peak force, and go through a CSV file, the reader and
`fit`. Then the true constant has each rank among draws of its posterior equally often. With *floor*
noise it is measured in the rests of a single test, with *correlated* noise all that is unknown has
its prior. The last series have mistakes made on purpose, and show what the test can see. *p of
uniform*, of a constant, is that of Neyman's smooth test of bias and spread, *p of no bias* that of
Hotelling's test; a series fails at 1 % (Bonferroni).
""",
        lambda: Table.read("ranks").markdown(),
    ),
    (
        """
## Comparing two pads

Pairs of pads with the paper's protocol at six speeds and correlated noise: half of them equal, a
quarter near (each constant off by 5 %, one sd), a quarter drawn independently. All tests of each
are fitted, and the two are compared with the default settings: one joint test of all shared
constants, and an interval of the difference of each quantity.
""",
        lambda: Table.read("pairs").markdown(),
    ),
    (
        """
## Is a right model called right, whatever the noise?

Pads with nothing hidden are read with noise of eight kinds and fitted with the right model. The
p-value of the adequacy test should be uniform (*KS*: p-value of Kolmogorov and Smirnov's test), and
`check` should accuse one pad in a hundred. In brackets: 95 % bounds. Without any hold the noise is
measured about smooth curves of single strokes, which take some of it for the pad's: there the
answer says that this is not testable. Without noise only low p-values mean anything.
""",
        lambda: Table.read("adequacy").markdown(),
    ),
    (
        """
## Is direct evidence right?

What readings show beyond doubt without a model is in every hypothesis of a diagnosis. It is counted
on pads of the lifelike and of the wide population, by the rules of names; nothing is fitted. The
bound is one-sided, 95 %, of pads for which something is beyond doubt that is not there.
""",
        lambda: Table.read("evidence").markdown(),
    ),
    (
        """
## Does what is fitted follow the readings?

Of the most probable fit without effects (*plain*), of the *answer* and of `qlvbayes fit` (*fit*):
how many pads are left with more than 1.05 times the root mean square that least squares of the
same model leaves of the block means, and the largest ratio. Least squares also follows correlated
noise, and readings next to a turning point of a fast motion, to which a fit gives little weight.
*Rises*: answers along whose steps the error rises, and the largest factor. *Lowers*: names that
lower the mean square on tests left out by more than its standard error, of those that can be
tested.
""",
        lambda: Table.read("budget").markdown(),
    ),
    (
        """
## Is the same mode found from other starts?

The mode of the true hypothesis is looked for from independent sets of starts, as the search does.
Of bundled pads, and where the package has nothing for what is hidden, it is the search's likeliest
hypothesis. A set agrees if its best mode is within 0.5 of the best of all in log density; the
search has *seen* the mode if its own is. A hypothesis that it has not looked at is *missed* if it
is at least as probable as the search's answer. Asked for is 99 % of both.
""",
        lambda: Table.read("modes").markdown(),
    ),
    (
        """
## Do proposed tests bring what is expected?

Tests proposed by `design` were done on simulated pads, by rules and goals that were registered
before. The scripts of this section and of bad readings are those of the commit stated.
""",
        lambda: Table.read("design_proof").markdown(),
    ),
    (
        """
The closed form by which tests are ranked, against nested Monte Carlo without it, in bits. *Lost*:
bits of the test that is best by Monte Carlo less those of the one that is best by the closed form.
""",
        lambda: Table.read("design_error").markdown(),
    ),
    (
        """
## Damaged files and killed runs

Files of every layout get one to four random changes each (bytes, numbers, lines, separators,
columns), and are given to the reader and to `convert`, and some of them to the first look. An
answer or one plain refusal is right.
""",
        lambda: Table.read("endurance_inputs").markdown(),
    ),
    (
        """
Commands are stopped by `kill -9` at random moments, up to four times in a row, and given again. All
files are compared with those of an undisturbed run, byte for byte, of `posterior.nc` all arrays.
""",
        lambda: Table.read("endurance_kills").markdown(),
    ),
    (
        """
One test of a sound record is spoiled in each way. *Found*: all spoiled readings were left out, or
the test refused; *also*: a sound reading was left out as well. What is not found lies mostly in
records of few readings a movement. The thresholds were set while looking at these pads.
""",
        lambda: Table.read("bad_readings").markdown(),
    ),
)
"""Sections of the page: their text, and the function that makes their table."""


def page() -> str:
    """Return the page."""
    parts = [*chain.from_iterable((text, table().rstrip()) for text, table in PARTS), *again()]
    return "\n".join(parts).rstrip() + "\n"


def again() -> list[str]:
    """Return a section of the smaller runs that repeated those above, if there are any."""
    names = sorted(path.stem for path in (RESULTS / "again").glob("*.json"))
    return [_AGAIN, *(Table.read(f"again/{name}").markdown() for name in names)] if names else []


_AGAIN = """
## Repeated by `make validate`

Smaller runs of the same counts by later commits:
"""


if __name__ == "__main__":
    write_whole(PAGE, page().encode())
