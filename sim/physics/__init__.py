"""A robot with mass, friction and weak servos in MuJoCo, behind the bus of the real one.

In: a robot's body file and profile, goals. Out: servo states, and a log of mass, soles and falls. May import as `sim`.
"""
