"""Which priority files a run uses: those of its options, else of the robot's profile."""

from retarget.options import RunOptions
from retarget.robot_body import RobotBody

__all__ = ["HUMAN_PRIORITIES", "name_with_mass", "priority_names"]

HUMAN_PRIORITIES = "human"
WITHOUT_MASS = "servo"
"""Looks at no motion. With mass another takes its place:"""
STANDING_WITH_MASS, HELD_WITH_MASS = "steady", "held"
"""of a robot on its own soles, and of one that hangs or is bolted down, whose servos lag behind."""


def priority_names(robot: RobotBody | None, options: RunOptions) -> tuple[str, ...]:
    """The priority files of the stages, by name or path; `--priorities` is the last one's."""
    if robot is None:
        return (options.priorities or HUMAN_PRIORITIES,)
    usual = name_with_mass(robot) if options.has_mass or options.steps == "shift" else robot.profile.retarget
    return robot.profile.reconstruct, options.priorities or usual


def name_with_mass(robot: RobotBody) -> str:
    """The priority file of a robot that has mass, by name or path, where no option names one."""
    profile = robot.profile
    if robot.stands and profile.standing is not None:
        return profile.standing
    if profile.retarget != WITHOUT_MASS:
        return profile.retarget
    return STANDING_WITH_MASS if robot.stands else HELD_WITH_MASS
