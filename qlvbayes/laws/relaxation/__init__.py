"""Relaxations: the reduced relaxation function g(t), handed over as a discrete spectrum."""
