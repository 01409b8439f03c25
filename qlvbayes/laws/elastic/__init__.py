"""Elastic laws: the force of an infinitely fast displacement, F_e(delta)."""
