"""A run kept as an MCAP file while it runs, read back, and run again: `retarget run --record`, `retarget replay`."""
