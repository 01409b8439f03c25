"""Define relaxation laws: the reduced relaxation function g(t) as a discrete spectrum."""
