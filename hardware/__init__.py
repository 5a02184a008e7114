"""The servo side of a robot.

In: checked goals, in rad. Out: servo states, and a latched stop. Buses, joint <-> tick map, servo data, IMU, and the
guard, which alone switches torque on and writes goals. Imports no sibling.
"""
