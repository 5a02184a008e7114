"""Stand-ins for hardware and performer: emulated servos, simulated mechanics, a synthetic performer.

In: a robot, goals or bytes. Out: servo states, bytes, sensor frames. May import `hardware` and `retarget`, except
`retarget.cli`, which alone imports this folder.
"""
