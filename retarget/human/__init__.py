"""Stage 1: a performer's sensors move a virtual human of their size.

Sensor samples (files, streams) come in, human postures go out. `reconstruction.py` is the stage, the other modules are
its steps, and the calibration of the performer. May import `ik` and all below it.
"""
