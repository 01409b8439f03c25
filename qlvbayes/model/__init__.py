"""Define the model of a specimen with its noise: forces, likelihood, posterior, choices."""
