"""Faults of a live run as a table, injected into the real pipeline above the bytes of emulated servos."""
