"""Effects in a form other than the list's law: which are tried, and what they are."""
