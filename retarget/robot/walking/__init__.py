"""Walking: a robot steps on its own soles while arms and head follow the performer.

In: desired velocity, posture of the standing robot. Out: postures of legs and root, goals. Imports as `retarget.robot`.
"""
