"""Design the next tests: the information, in bits, of each test that the rig can do."""
