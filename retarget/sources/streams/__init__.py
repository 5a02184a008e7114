"""Decoders of live streams: the bytes of a datagram -> sensor frames, without a socket or a clock."""
