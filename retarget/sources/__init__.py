"""Readers of motion files and decoders of live streams (`streams/`).

In: a path or the bytes of a datagram. Out: `retarget.frames.SensorFrames` or `streams.stream_frame.StreamFrame`. They
import `schema` and `model`; they open no socket and read no clock.
"""
