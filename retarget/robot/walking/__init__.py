"""Walking: a robot steps on its own soles while arms and head follow the performer.

In: a desired velocity, and the posture of the standing robot. Out: postures of legs and root on a path that ends
standing, and goals that hold servos in them. Imports what `retarget.robot` may.
"""
