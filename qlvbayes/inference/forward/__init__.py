"""Compute the force of any hypothesis by compiled pieces that all of them share."""
