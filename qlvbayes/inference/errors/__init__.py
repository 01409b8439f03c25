"""Model what a record holds apart from the force: noise, and a smooth discrepancy."""
