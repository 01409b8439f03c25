"""Count how often each effect would be named, with a user's pad, noise and tests."""
