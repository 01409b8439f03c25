"""Files as testing machines write them: one format a file, and what they say made tidy."""
