"""How far answers can be trusted: blind studies on what the simulator hides, and their scores."""
