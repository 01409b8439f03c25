"""Define drag of the guide: it resists the platen's speed also where the pad is not touched."""

from __future__ import annotations

from typing import ClassVar

from qlvbayes.effects.effect import Level
from qlvbayes.effects.power_law_drag import PowerLawDrag
from qlvbayes.effects.viscous_drag import ViscousDrag
from qlvbayes.priors.distributions import Constant


class GuideDrag(ViscousDrag):
    """Drag of the rig: F = F_below + eta v, v the platen's velocity, outside the contact.

    Oil in a bearing, or air or a bath around the platen, drags where the pad is off it too, and
    makes the force negative there on the way back. While the pad is pressed this is viscous_drag.

    * ``eta``: drag coefficient (N s/mm), zero or more.
    """

    eta: Constant
    name: ClassVar[str] = "guide_drag"
    level: ClassVar[Level] = Level.GUIDE
    rank: ClassVar[int] = 1
    off_pad: ClassVar[bool] = True
    generalises: ClassVar[str] = ViscousDrag.name
    law: ClassVar[str] = "F += eta v, also off the pad"
    seen: ClassVar[str] = "steps of the force at each start and stop, also where nothing is touched"
    reference: ClassVar[str] = "Stokes 1851; Stribeck 1902, Z. VDI 46"


class GuidePowerLawDrag(PowerLawDrag):
    """Drag of the rig that grows more slowly than speed: F = F_below + k abs(v)^n sgn v.

    v is the platen's velocity in mm/s. Grease in a bearing shears so, where the pad is off the
    platen too. While the pad is pressed this is power_law_drag.

    * ``k``: drag at 1 mm/s (N (s/mm)^n), zero or more.
    * ``n``: exponent, above 0 and below 1, where 1 is guide_drag.
    """

    k: Constant
    n: Constant
    name: ClassVar[str] = "guide_power_law_drag"
    level: ClassVar[Level] = Level.GUIDE
    rank: ClassVar[int] = 2
    off_pad: ClassVar[bool] = True
    generalises: ClassVar[str] = PowerLawDrag.name
    law: ClassVar[str] = "F += k |v|^n sgn v, also off the pad"
    seen: ClassVar[str] = "steps of the force that grow slowly with speed, also off the pad"
    reference: ClassVar[str] = "Herschel & Bulkley 1926, doi:10.1007/BF01432034"
