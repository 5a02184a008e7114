"""Measures finished runs and robot motions: report, findings in words, and JSON.

Input: a run's record or an exported motion. Output: `Report`, `Judgement` and lines of text. It imports `recording`,
`run` and what they import.
"""
