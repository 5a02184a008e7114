"""Lines of emulated Dynamixel servos.

In: bytes of a host, faults. Out: bytes of the servos, each at its time on the wire. May import as `sim`.
"""
