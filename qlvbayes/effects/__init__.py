"""Physical effects that a model may lack: one file, one effect."""
