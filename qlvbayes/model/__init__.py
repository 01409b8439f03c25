"""A specimen with its noise: forces, likelihood, posterior, and what a user chooses."""
