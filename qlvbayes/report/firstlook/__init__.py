"""A first look at a pad's tests, before anything is fitted: readings, and what they can show."""

from qlvbayes.report.firstlook.looking import look_at
from qlvbayes.report.firstlook.result import FirstLook, PadSeen, Shown, TestSeen

__all__ = ["FirstLook", "PadSeen", "Shown", "TestSeen", "look_at"]
