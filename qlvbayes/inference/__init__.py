"""Ways to find a posterior: optimum with normal approximation, least squares, emcee."""
