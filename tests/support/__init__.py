"""What several test files need: motions, pads, results, pages."""
