"""What a record holds beside the force: the noise floor, and a smooth discrepancy."""
