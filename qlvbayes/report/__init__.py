"""One self-contained page with the results of a study."""
