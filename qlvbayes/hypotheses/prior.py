"""What is held likely before the tests: all in one place, in few numbers."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

from qlvbayes.inference.space import Hypothesis

TOLERANCE = 0.01
"""Share of the peak force below which neither an effect nor a discrepancy matters."""


@dataclass(frozen=True)
class HypothesisPrior:
    """Prior probabilities of hypotheses.

    complete: that no (further) effect is missing, asked anew after each; usual: that the elastic
    law, and likewise the relaxation, is the one that the user chose, the others sharing the rest
    alike.
    """

    complete: float = 0.5
    usual: float = 0.5

    def log(
        self,
        hypothesis: Hypothesis,
        usual: Hypothesis,
        laws: tuple[Collection[str], Collection[str]],
        candidates: int,
    ) -> float:
        r"""Log prior probability; laws: elastic ones and relaxations; candidates: effects in all.

        Sets of k effects are equally likely: p(set) = c (1 - c)^k / (N over k).
        """
        count = len(hypothesis.effects)
        total = math.log(self.complete) + count * math.log1p(-self.complete)
        total -= math.log(math.comb(candidates, count))
        pairs = (
            (hypothesis.elastic, usual.elastic, laws[0]),
            (hypothesis.relaxation, usual.relaxation, laws[1]),
        )
        for law, own, known in pairs:
            if len(known) == 1:
                continue
            share = self.usual if law == own else (1.0 - self.usual) / (len(known) - 1)
            total += math.log(share)
        return total
