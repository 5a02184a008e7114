"""Writes and reads motions in the formats of other programs.

Input: a `Motion`, or a file. Output: a file or folder, or a `Motion`.
"""
