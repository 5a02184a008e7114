"""`retarget servo COMMAND`: work with servos outside a run. A module has the function of its command.

In: options, servos on a port. Out: settings, calibrations and tables on the terminal. May import as `retarget.cli`.
"""

COMMANDS = {
    "scan": "Find every servo on a port.",
    "setup": "Give one servo its id, speed and settings, or all, one by one.",
    "monitor": "Watch all servos; nothing is written.",
    "rest": "Switch torque off: the robot goes limp.",
    "reboot": "Clear latched errors by a restart.",
    "home": "Find the zero of each servo: place the robot in a known posture.",
    "stiffness": "Measure how stiff a servo is: held goals under a known load.",
}
"""The line of each command in the help."""


def servo() -> None:
    """Work with a robot's servos: nothing here moves a joint, but `stiffness`."""
