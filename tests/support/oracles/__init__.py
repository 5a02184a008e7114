"""Slow, plain references that the solver is held to; nothing here imports the code under test."""
