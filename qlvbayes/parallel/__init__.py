"""Do one task for many pads or studies: here, in spawned processes, or on a cluster."""
