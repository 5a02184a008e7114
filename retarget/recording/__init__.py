"""A run kept: MCAP and NPZ files, read back, run again, and exported."""
