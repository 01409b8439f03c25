"""Offer what several test files need: motions, pads, results, pages."""
