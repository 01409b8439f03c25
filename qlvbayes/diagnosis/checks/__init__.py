"""Checks of hypotheses against the tests: structure that is left, tests left out, support."""
