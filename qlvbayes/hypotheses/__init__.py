"""Hypotheses about what a specimen is and what the model lacks: weighed, searched, decided."""
