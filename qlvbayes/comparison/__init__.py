"""Two pads, or two fluids, set against each other."""
