"""The model of a specimen with its noise: forces, likelihood, posterior, and a user's choices."""
