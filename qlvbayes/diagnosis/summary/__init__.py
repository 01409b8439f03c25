"""The summary of a finished search: the result, the verdict in words, curves, discrepancy."""
