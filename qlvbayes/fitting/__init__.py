"""Estimate constants from tests, predicts tests, checks the fit and stores results."""
