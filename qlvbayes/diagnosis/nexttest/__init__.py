"""Which test to do next: what each that the rig can do would tell, per minute of its time."""
