"""From a finished search to what is said of it."""
