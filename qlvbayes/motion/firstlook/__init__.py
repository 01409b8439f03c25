"""A first look at a pad's tests, before anything is fitted: readings, and what they can show."""

from qlvbayes.motion.firstlook.looking import look_at
from qlvbayes.motion.firstlook.result import FirstLook, PadSeen, Shown, TestSeen

__all__ = ["FirstLook", "PadSeen", "Shown", "TestSeen", "look_at"]
