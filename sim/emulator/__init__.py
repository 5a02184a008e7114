"""A line of Dynamixel servos that answers on the wire as the real ones would."""
