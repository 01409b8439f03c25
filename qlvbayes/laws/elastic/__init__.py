"""Define elastic laws: the force F_e(delta) of an infinitely fast displacement."""
