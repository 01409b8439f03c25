"""The evidence of hypotheses: one density, its modes, importance sampling, nested sampling."""
