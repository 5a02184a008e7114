"""The servo side of a robot: buses, joint <-> tick map, servo data, IMU, and the guard.

In: checked goals. Out: servo states, and a latched stop. Imports no sibling.
"""
