"""Define friction of the guide: it rubs on the platen's way also where the pad is not touched."""

from __future__ import annotations

from typing import ClassVar

from qlvbayes.effects.effect import Level
from qlvbayes.effects.sharp_friction import SharpFriction
from qlvbayes.priors.distributions import Constant


class GuideFriction(SharpFriction):
    """Friction of the rig: F = F_below + strength ((1 - sharp) z + sharp s), outside the contact.

    z and s are those of sharp_friction, along the platen's displacement. A guide or a bearing
    between platen and load cell rubs where the pad is off the platen too, and makes the force
    negative there on the way back. While the pad is pressed this is sharp_friction.

    * ``strength``: force of steady sliding (N), zero or more.
    * ``reach``: distance over which the spring yields, and over which Dahl's z follows (mm).
    * ``sharp``: share that yields at once, from 0 (Dahl) to 1 (elastic, then sliding).
    """

    strength: Constant
    reach: Constant
    sharp: Constant
    name: ClassVar[str] = "guide_friction"
    level: ClassVar[Level] = Level.GUIDE
    rank: ClassVar[int] = 0
    off_pad: ClassVar[bool] = True
    law: ClassVar[str] = "F += strength ((1 - sharp) z + sharp s), also off the pad"
    seen: ClassVar[str] = "a force against the motion, at any speed, also where nothing is touched"
    reference: ClassVar[str] = "Armstrong-Helouvry et al. 1994, doi:10.1016/0005-1098(94)90209-7"
