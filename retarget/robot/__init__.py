"""Stage 2: a human posture becomes a robot posture within the limits of its servos, on its soles.

In: `HumanPosture`, robot, priorities, scene. Out: `RobotPosture`, stops, goals. Imports `human` and all below.
"""
