"""Read and write files: measurements, machines' layouts, units, results, error messages."""
