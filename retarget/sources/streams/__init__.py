"""Decoders of live streams.

In: the bytes of a datagram. Out: `stream_frame.StreamFrame`. They import as `sources` does, and use no socket and no
clock.
"""
