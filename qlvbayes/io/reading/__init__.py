"""Read a tidy CSV file, from bytes to checked columns."""
