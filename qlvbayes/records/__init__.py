"""Tests as the likelihood sees them: block averages, batched."""
