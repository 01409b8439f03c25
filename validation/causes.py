r"""Find why a verdict is wrong, from numbers alone.

Of a study there are three log posteriors, all by Laplace's evidence about modes: *truth*, of the
likeliest true hypothesis at the best mode that was reached, by the search (in any form of its
effects) or from the truth; *seen*, of the likeliest true hypothesis as the search left it (minus
infinity where it saw none); *answer*, of the hypothesis that stands for the verdict. Three nats (20
to 1) are what counts. The first that applies:

1. ``left out``: no true hypothesis is among those that the search tries in these tests;
2. ``search``: seen < truth - 3 and truth >= answer - 3: had the search been there, it would have
   said otherwise;
3. ``imitation``: something outside every list is hidden, and the verdict names what is not there,
   or says that nothing unlisted is;
4. truth > answer + 3, or the answer is the true hypothesis itself: ``verdict`` where the truth's
   own fit passes as noise, or something outside every list is hidden with it: a veto, or the
   rule for what is left, refused it; ``error budget`` where nothing but noise is left and it does
   not pass;
5. ``undecided``: the truth is within 3 nats of the answer;
6. the truth is more than 3 nats below: ``imitation`` where its own fit passes as noise: another
   explains as well; ``error budget`` where it does not: the truth is taken to be improbable.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NATS = 3.0
"""Log posterior odds that count: 20 to 1."""
CAUSES = ("search", "error budget", "imitation", "undecided", "verdict", "left out", "failed")
RIGHT = "right"


@dataclass(frozen=True)
class Compared:
    """Numbers from which the cause follows.

    truth, seen, answer: log posteriors, None where the hypothesis cannot be tried; sound: whether
    what the truth's own fit leaves passes as noise; same: whether the answer is true; outsider:
    whether something outside every list is hidden; misled: whether the verdict names what is not
    hidden, or says that nothing unlisted is there.
    """

    truth: float | None
    seen: float
    answer: float
    sound: bool
    same: bool
    outsider: bool
    misled: bool

    @property
    def cause(self) -> str:
        """Return the first cause that applies."""
        if self.truth is None:
            return "left out"
        if self.seen < self.truth - NATS and self.truth >= self.answer - NATS:
            return "search"
        if self.outsider and self.misled:
            return "imitation"
        if self.same or self.truth > self.answer + NATS:
            return "verdict" if self.sound or self.outsider else "error budget"
        if self.truth >= self.answer - NATS:
            return "undecided"
        return "imitation" if self.sound else "error budget"


def carrying_half(parts: Array) -> list[int]:
    """Return the indices of the fewest parts that carry half of their sum, the largest first.

    parts (n,): what each block mean adds to a difference of log likelihoods. None where their sum
    is not positive.
    """
    total = float(parts.sum())
    if not (total > 0.0 and math.isfinite(total)):
        return []
    order = np.argsort(-parts, kind="stable")
    count = int(np.searchsorted(np.cumsum(parts[order]), 0.5 * total)) + 1
    return [int(k) for k in order[:count]]


def one_by_one(precision: Array, residual: Array) -> tuple[Array, Array]:
    """Return n residuals over their sds, each given those before, and the log of one over the sd.

    precision (n, n): of all together. With the residuals in the opposite order and its Cholesky
    factor L, L^T r are independent and of unit variance; the log density is the sum of
    ln L_kk - (L^T r)_k^2 / 2, up to n ln(2 pi)/2.
    """
    factor = np.linalg.cholesky(precision[::-1, ::-1])
    free = factor.T @ residual[::-1]
    return np.asarray(free[::-1]), np.log(np.diag(factor))[::-1]
