"""The levels that the blind studies must reach, and what they reached."""

from __future__ import annotations

from dataclasses import dataclass

from qlvbayes.evaluation.rate import Rate
from qlvbayes.evaluation.report import Report


@dataclass(frozen=True)
class Level:
    """One requirement: what was found, with its sample size, between two bounds."""

    words: str
    found: float | None
    error: float | None
    n: int
    low: float | None
    high: float | None
    percent: bool = True

    @property
    def met(self) -> bool:
        """Whether the figure itself, not its interval, is within; never without any study."""
        if self.found is None:
            return False
        above = self.low is None or self.found >= self.low
        return above and (self.high is None or self.found <= self.high)

    @property
    def in_doubt(self) -> bool:
        """Whether a bound is within two standard errors of the figure."""
        if self.found is None or self.error is None:
            return self.found is None
        bounds = [bound for bound in (self.low, self.high) if bound is not None]
        return any(abs(self.found - bound) < 2.0 * self.error for bound in bounds)

    @property
    def asked(self) -> str:
        """The bounds in words."""
        low, high = (None if x is None else self._text(x) for x in (self.low, self.high))
        if low and high:
            return f"{low} to {high}"
        return f"at least {low}" if low else f"at most {high}"

    @property
    def shown(self) -> str:
        """The figure with its standard error."""
        if self.found is None:
            return "-"
        text = self._text(self.found, digits=1)
        return text if self.error is None else f"{text} ± {self._text(self.error, digits=1)}"

    def _text(self, value: float, digits: int = 0) -> str:
        return f"{100 * value:.{digits}f} %" if self.percent else f"{value:.3g}"


def levels(report: Report) -> list[Level]:
    """Every requirement; rates are over the studies whose hidden effect could be seen."""
    seen = {name: found["seen"] for name, found in report.rates.items()}
    errors, left = report.reliability, report.heldout["single"]
    rows = [
        _share("one effect: named", seen["single_right"], low=0.95),
        _share(
            "one effect: named, or in a group of at most 3",
            seen["single_right_or_group"], low=0.99,
        ),
        _share("nothing missing: an effect named", seen["false_alarm"], high=0.02),
        _share("two effects: both named", seen["double_both"], low=0.85),
        _share("other form: its family named", seen["form_family"], low=0.90),
        _share("outside the list: unexplained", seen["outside_unexplained"], low=0.90),
        _share("outside the list: confident wrong name", seen["outside_confident"], high=0.05),
        Level(
            "expected calibration error of probabilities",
            errors.error, None, errors.n, None, 0.05, percent=False,
        ),
        Level(
            "one effect: error on left-out tests / noise, median",
            left["final"], None, int(left["n"] or 0), None, 1.05, percent=False,
        ),
    ]  # fmt: skip
    rows += [
        _share(f"one effect: 90 % interval of {c.name} holds the truth", c.after, 0.85, 0.95)
        for c in report.constants.values()
        if c.name != "all"
    ]
    return rows


def _share(words: str, rate: Rate, low: float | None = None, high: float | None = None) -> Level:
    return Level(words, rate.share, rate.error, rate.n, low, high)
