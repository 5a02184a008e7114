"""What physics needs of a robot's files, beyond what following needs."""

from math import isnan
from typing import Any

from retarget.body_file import body_spec
from retarget.errors import ConfigError
from retarget.robot_body import RobotBody
from sim.physics.mount import check_mount, mount_of
from sim.physics.position_loop import lacks_gain

__all__ = ["check_gains", "check_masses", "lacking"]

DEFAULT_DENSITY = 1000.0
"""Of a shape whose file says none: then its mass is a guess from its volume."""
LEAST_MASS = 1e-5
"""What a servo moves weighs more, kg."""
MAX_NAMED = 5


def lacking(robot: RobotBody) -> ConfigError | None:
    """Why a robot, as its profile says that it stands or hangs, cannot be simulated; None: it can."""
    try:
        check_mount(robot, mount_of(robot))
        check_gains(robot)
        check_masses(robot, body_spec(robot.profile.body_path, root=robot.profile.root))
    except ConfigError as error:
        return error
    return None


def check_masses(robot: RobotBody, spec: Any) -> None:
    """Raise ConfigError for links that nobody has weighed. spec: of the body, as it was read."""
    body = robot.body
    below = body.mass.copy()
    for link in range(len(below) - 1, 0, -1):
        below[body.parent[link]] += below[link]
    light = [body.body_names[link] for link in body.joint_body.tolist() if below[link] < LEAST_MASS]
    guessed = [link.name for link in spec.bodies if not link.explicitinertial and any(map(_guessed, link.geoms))]
    for links, what in (
        (light, "without a mass"),
        (guessed, "with a mass that is only guessed from its shape"),
    ):
        if links:
            raise ConfigError(
                f"{_counted(links, 'link')} {what}",
                where=body.source,
                found=_some(links),
                allowed="an <inertial> with mass, centre of mass and inertia for every link that moves",
                next_step="Take them from the robot's CAD model; without them there is no physics",
            )


def check_gains(robot: RobotBody) -> None:
    """Raise ConfigError for servos whose stiffness the profile does not say."""
    protocols = {bus.name: bus.protocol for bus in robot.profile.bus_specs()}
    unknown = [s.joint for s in robot.joint_map.servos if lacks_gain(s, protocol=protocols[s.bus])]
    if unknown:
        raise ConfigError(
            f"{_counted(unknown, 'servo')} without a P gain",
            where=f"{robot.profile.path}: servos",
            found=_some(unknown),
            allowed="gains: {p: ...} for every servo",
            next_step="Write the gains that its servos run with into the profile",
        )


def _guessed(geom: Any) -> bool:
    return isnan(geom.mass) and geom.density == DEFAULT_DENSITY


def _counted(names: list[str], what: str) -> str:
    return f"{len(names)} {what}{'s' if len(names) > 1 else ''}"


def _some(names: list[str]) -> str:
    return ", ".join(names[:MAX_NAMED]) + (", ..." if len(names) > MAX_NAMED else "")
