"""Faults, injected into live runs of the real pipeline above emulated servos, and their judge.

In: rows of `rows.yaml`, bounds of `bounds.yaml`. Out: a verdict on each run. May import all of `sim`, and `retarget`
except `retarget.cli`.
"""
