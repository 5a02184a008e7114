"""The mount of a simulated robot: floor, stand or gantry, the hand that holds it first, and their checks."""

from dataclasses import dataclass
from enum import StrEnum
from math import isnan
from typing import Any

import numpy as np

from hardware.errors import counted
from retarget.errors import ConfigError
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.support_polygon import plant
from retarget.model.body import Frame
from retarget.model.body_file import body_spec, engine
from retarget.model.robot import RobotBody
from retarget.types import FloatArray
from sim.physics.motors import gain_missing


class Support(StrEnum):
    """floor: on its own soles. stand: its root is fixed. gantry: it hangs from a rope, and swings."""

    FLOOR = "floor"
    STAND = "stand"
    GANTRY = "gantry"


@dataclass(frozen=True)
class Mount:
    """A mount. hook: frame of the profile where the rope holds the robot. lift: height of the soles over the floor on a
    stand or gantry, m. rope: its length, m."""

    support: Support
    hook: str = "hook"
    lift: float = 0.2
    rope: float = 0.3


_BY_ROOT = {"free": Support.FLOOR, "fixed": Support.STAND, "suspended": Support.GANTRY}


def mount_of(robot: RobotBody) -> Mount:
    """The mount that the profile's root names."""
    return Mount(_BY_ROOT[robot.profile.root])


def check_mount(robot: RobotBody, mount: Mount) -> None:
    """Raise ConfigError for a robot that cannot stand or hang on this mount."""
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
            next_step=f"Add a frame {mount.hook!r} on the torso, or name one of these with --hook",
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


RELEASE_S = 0.6
"""Time, s, from the first torque to the end of the hold."""
HAND = "physics_hand"
FIRM, LOOSE = 0.9, 0.001
"""Impedance of the hold (MuJoCo, solimp) at its begin and end."""
HOLD_SOLREF = (0.03, 1.0)
"""Time constant s and damping ratio of the hold: a soft grip."""


def add_hand(spec: Any, root: str) -> None:
    """Add a hand that holds the root link of a body."""
    mujoco = engine()
    spec.worldbody.add_body(name=HAND, mocap=True)
    hold = spec.add_equality(name=HAND, type=mujoco.mjtEq.mjEQ_WELD, name1=root, name2=HAND)
    hold.objtype = mujoco.mjtObj.mjOBJ_BODY
    hold.solref = HOLD_SOLREF
    hold.solimp = [FIRM, FIRM, 0.001, 0.5, 2.0]


class Hand:
    """Holds the root link of a compiled model, as a person holds a robot that cannot stand yet.

    Until the first torque no time passes for the mechanics. From then on the hold softens, and ends after RELEASE_S.
    """

    def __init__(self, model: Any, data: Any, root: int) -> None:
        self._model, self._data = model, data
        self._hold = model.equality(HAND).id
        self._released: float | None = None
        self.holding = True
        model.eq_data[self._hold] = 0.0
        model.eq_data[self._hold, 6] = 1.0  # relative orientation: none
        model.eq_data[self._hold, 10] = 1.0  # turns are held as firmly as places
        mocap = model.body(HAND).mocapid[0]
        data.mocap_pos[mocap] = data.qpos[:3]
        data.mocap_quat[mocap] = data.qpos[3:7]

    def let_go(self, now: float) -> None:
        """Begin to release at `now`, s of the engine; only the first call counts."""
        if self._released is None:
            self._released = now

    def ease(self, now: float) -> None:
        """Set the firmness of the hold at `now`, s of the engine."""
        if not self.holding or self._released is None:
            return
        share = (now - self._released) / RELEASE_S
        if share >= 1.0:
            self.holding = False
            self._data.eq_active[self._hold] = 0
            return
        firm = LOOSE + (FIRM - LOOSE) * 0.5 * (1.0 + float(np.cos(np.pi * share)))
        self._model.eq_solimp[self._hold, :2] = firm


ROPE, HOOK, TOP = "physics_rope", "physics_hook", "physics_rope_top"
SWING_DAMPING = 0.5
"""Damping of the straps of a gantry, N s/m per kg of robot."""
TURN_DAMPING = 0.01
"""Their rotational damping, N m s/rad per kg."""


def add_rope(spec: Any, link: str, frame: Frame, *, at: FloatArray, length: float) -> None:
    """Hang a body by the hook `frame` on `link`, at `at` (3,) m, world, from a rope of `length` m."""
    spec.body(link).add_site(name=HOOK, pos=frame.position)
    spec.worldbody.add_site(name=TOP, pos=at + np.array([0.0, 0.0, length]))
    rope = spec.add_tendon(name=ROPE)
    rope.limited, rope.range = True, [0.0, length]
    rope.solref_limit = [0.02, 1.0]
    rope.wrap_site(TOP)
    rope.wrap_site(HOOK)


def damp_swinging(model: Any, weight: float) -> None:
    """Damp a hanging robot of `weight` N, whose free joint is the first."""
    mass = weight / GRAVITY
    model.dof_damping[:3] = SWING_DAMPING * mass
    model.dof_damping[3:6] = TURN_DAMPING * mass


DEFAULT_DENSITY = 1000.0
"""Density of a shape without one in its file, kg/m^3: its mass is guessed from its volume."""
LEAST_MASS = 1e-5
"""Least mass that a servo must move, kg."""
MAX_NAMED = 5
"""Servos that a message names."""


def simulation_problem(robot: RobotBody) -> ConfigError | None:
    """Return why a robot cannot be simulated on the mount of its profile; None: it can."""
    try:
        check_mount(robot, mount_of(robot))
        check_gains(robot)
        check_masses(robot, body_spec(robot.profile.body_path, root=robot.profile.root))
    except ConfigError as error:
        return error
    return None


def check_masses(robot: RobotBody, spec: Any) -> None:
    """Raise ConfigError for links without a mass of their own. spec: the body as it was read."""
    body = robot.body
    below = body.mass.copy()
    for link in range(len(below) - 1, 0, -1):
        below[body.parent[link]] += below[link]
    light = [body.body_names[link] for link in body.joint_body.tolist() if below[link] < LEAST_MASS]
    guessed = [
        link.name
        for link in spec.bodies
        if not link.explicitinertial and any(isnan(g.mass) and g.density == DEFAULT_DENSITY for g in link.geoms)
    ]
    for links, what in (
        (light, "without a mass"),
        (guessed, "with a mass that is only guessed from its shape"),
    ):
        if links:
            raise ConfigError(
                f"{counted(len(links), 'link')} {what}",
                where=body.source,
                found=_some(links),
                allowed="an <inertial> with mass, centre of mass and inertia for every link that moves",
                next_step="Take them from the robot's CAD model; without them there is no physics",
            )


def check_gains(robot: RobotBody) -> None:
    """Raise ConfigError for servos without a P gain in the profile."""
    unknown = [servo.joint for servo in robot.joint_map.servos if gain_missing(servo)]
    if unknown:
        raise ConfigError(
            f"{counted(len(unknown), 'servo')} without a P gain",
            where=f"{robot.profile.path}: servos",
            found=_some(unknown),
            allowed="gains: {p: ...} for every servo",
            next_step="Write the gains that its servos run with into the profile",
        )


def _some(names: list[str]) -> str:
    return ", ".join(names[:MAX_NAMED]) + (", ..." if len(names) > MAX_NAMED else "")
