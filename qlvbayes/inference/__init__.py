"""Compute the evidence of hypotheses: density, modes, Laplace and sampling."""
