"""Predict what a specimen will do in a motion or under a load that it has not seen."""
