"""What the platen did: a smooth trajectory and its phases."""
