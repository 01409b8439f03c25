"""Write one self-contained page with the results of a study."""
