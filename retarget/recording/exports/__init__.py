"""Motions in the formats that others read."""
