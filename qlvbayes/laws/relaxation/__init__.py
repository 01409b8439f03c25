"""Relaxation laws: the reduced relaxation function g(t), given as a discrete spectrum."""
