"""Describe what no listed effect explains: the smallest law that removes the error."""
