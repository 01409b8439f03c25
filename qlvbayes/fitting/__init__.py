"""Constants from tests: least squares and emcee, predictions, where they fail, results."""
