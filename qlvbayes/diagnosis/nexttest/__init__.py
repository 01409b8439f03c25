"""The design of the next tests: what each test that the rig can do would tell, in bits."""
