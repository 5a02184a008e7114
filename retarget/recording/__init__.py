"""Records runs, reads and replays them, and exports motions.

Input: the ticks of a run, or a file. Output: MCAP, NPZ, `Motion`, and the inputs of a replay. It imports `run` and
below.
"""
