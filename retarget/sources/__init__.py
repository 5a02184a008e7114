"""Readers of motion files: one file per format, each yields `retarget.frames.SensorFrames`. Streams: `streams/`."""
