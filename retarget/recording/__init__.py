"""Records runs to MCAP and NPZ, reads and replays them, and exports motions.

Input: the ticks of a run, or a file. Output: files, `Motion`, and the inputs of a replay. It imports `run` and what
`run` imports.
"""
