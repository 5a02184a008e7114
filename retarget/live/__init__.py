"""Live streams: one clock, a playout buffer and filters, between the decoders and the pipeline. Nothing here reads a
clock, opens a socket or sleeps."""
