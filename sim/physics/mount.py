"""What a simulated robot stands on or hangs from."""

from dataclasses import dataclass
from enum import StrEnum

from retarget.errors import ConfigError
from retarget.robot_body import RobotBody
from retarget.stance import plant

__all__ = ["Mount", "Support", "check_mount", "mount_of"]


class Support(StrEnum):
    """floor: on its own soles. stand: its root is bolted down. gantry: it hangs from a rope, and swings."""

    FLOOR = "floor"
    STAND = "stand"
    GANTRY = "gantry"


@dataclass(frozen=True)
class Mount:
    """hook: frame of the profile where the rope holds the robot. lift: height of the soles over the floor where they
    do not carry, m. rope: its length, m."""

    support: Support
    hook: str = "hook"
    lift: float = 0.2
    rope: float = 0.3


_BY_ROOT = {"free": Support.FLOOR, "fixed": Support.STAND, "suspended": Support.GANTRY}


def mount_of(robot: RobotBody) -> Mount:
    """How the profile's root says that the robot stands."""
    return Mount(_BY_ROOT[robot.profile.root])


def check_mount(robot: RobotBody, mount: Mount) -> None:
    """Raise ConfigError for a robot that cannot stand or hang so."""
    profile = robot.profile
    where = str(profile.path)
    if mount.support is Support.FLOOR and not robot.stands:
        raise ConfigError(
            "the robot does not stand on feet",
            where=where,
            found=f"root {profile.root}, {len(profile.feet)} feet",
            allowed="root free, and at least one foot with its sole polygon",
            next_step="Describe its soles in `feet`, or simulate it on a stand or on a gantry",
        )
    if mount.support is not Support.GANTRY:
        return
    if mount.hook not in profile.frames:
        raise ConfigError(
            "no hook point to hang the robot from",
            where=f"{where}: frames",
            found=f"no frame {mount.hook!r}",
            allowed=f"a frame above the centre of mass; there are {', '.join(profile.frames)}",
            next_step=f"Add a frame {mount.hook!r} on the torso, or name one of these as the hook",
        )
    stance = plant(robot, profile.postures.stand)
    above = float(stance.points[mount.hook][2] - robot.body.solver_body().centre_of_mass(stance.q[None])[0][2])
    if above <= 0.0:
        raise ConfigError(
            "the hook is below the centre of mass: the robot would turn over",
            where=f"{where}: frames.{mount.hook}",
            found=f"{1e3 * above:.0f} mm above it in posture stand",
            allowed="above 0",
            next_step="Take a point higher on the torso",
        )
