"""The force of any hypothesis: laws and effects with their numbers, compiled for all at once."""
