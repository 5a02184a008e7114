"""`retarget servo COMMAND`: work with servos outside a run. One file per command, with a function of its name."""

COMMANDS = {
    "scan": "Find every servo on a port.",
    "setup": "Give one servo its id, speed and settings, or all, one by one.",
    "monitor": "Watch all servos; nothing is written.",
    "rest": "Switch torque off: the robot goes limp.",
    "reboot": "Clear latched errors by a restart.",
    "home": "Find the zero of each servo: place the robot in a known posture.",
    "stiffness": "Measure how stiff a servo is: held goals under a known load.",
}
"""Every command and its line in the list of commands."""


def servo() -> None:
    """Work with a robot's servos: nothing here moves a joint, but `stiffness`."""
