"""Lines of emulated Dynamixel servos: bytes of a host in, bytes of the servos out, each at its time on the wire."""
