"""Readers of performer motion: one file per format, each yields `retarget.frames.SensorFrames`."""
