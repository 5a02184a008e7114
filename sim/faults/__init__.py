"""A table of faults, injected into live runs of the real pipeline above emulated servos, and their judge."""
