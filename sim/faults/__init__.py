"""Everything that may go wrong in a live run, as a table, through the real pipeline and the emulator's bytes."""
