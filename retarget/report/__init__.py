"""Measures finished runs and robot motions.

Input: a run's record, or a motion. Output: `Report`, `Judgement` and findings in words. It imports `recording` and
below.
"""
