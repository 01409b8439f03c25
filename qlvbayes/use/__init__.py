"""Constants put to use: forces of any programme, a state to step, exports to other programs."""
