"""What the tests themselves say of hypotheses: what is left, tests left out, vetoes."""
