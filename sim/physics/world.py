"""The world of a simulated robot: its body on a floor, a stand or a gantry, compiled for the engine."""

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardware.motors import drive_numbers
from hardware.servo import loop_stiffness
from retarget.errors import ConfigError
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.support_polygon import Stance, plant
from retarget.model.body import Frame
from retarget.model.body_file import body_spec, engine
from retarget.model.robot import RobotBody
from retarget.schema.scene import HERE, Pose, Scene
from retarget.types import FloatArray
from sim.physics.ground import FIXTURE, FLOOR, add_fixtures, add_floor, add_soles, sort_shapes
from sim.physics.motors import Drive, add_motors, position_loop
from sim.physics.mount import Mount, Support, add_hand, add_rope, check_gains, check_masses, check_mount
from sim.physics.perturbation import Perturbation

HAND_LANDMARKS = ("l_hand", "r_hand")
STEP_S = 0.002
"""Step of the engine, s."""
ITERATIONS, LINE_ITERATIONS = 20, 50
"""Most iterations of the contact solver, which starts warm and needs one or two, and of its line search: with fewer it
sometimes ends far from the solution, and soles jump."""
IMPEDANCE_RATIO = 10.0
"""Ratio of the impedances of friction and normal force (MuJoCo, impratio): with less, soles creep under any load."""


@dataclass(frozen=True, eq=False)
class World:
    """A compiled world and the meaning of its indices.

    model: `mujoco.MjModel`. drives: in servo order. root: index of the root link. free: the root moves. columns (nj,):
    of the joints of the robot's q, without its root, in the engine's. owners (ngeom,): 0 the floor, 1 + i the foot of
    sole i, HANDS, ROBOT or FIXTURES. start: first coordinates of the engine.
    """

    robot: RobotBody
    mount: Mount
    model: Any
    drives: tuple[Drive, ...]
    root: int
    free: bool
    columns: NDArray[np.intp]
    soles: tuple[Frame, ...]
    owners: NDArray[np.int64]
    start: FloatArray

    HANDS = 99
    ROBOT = 100
    FIXTURES = 101

    @cached_property
    def step(self) -> float:
        """Step of the engine, s."""
        return float(self.model.opt.timestep)

    @cached_property
    def start_angles(self) -> FloatArray:
        """First angles of the servo joints, (n,) rad."""
        columns = [self.model.joint(drive.servo.joint).qposadr[0] for drive in self.drives]
        return np.asarray(self.start[columns])

    @cached_property
    def weight(self) -> float:
        """Weight of the robot, N."""
        return float(self.model.body_subtreemass[self.root] * -self.model.opt.gravity[2])


def build_world(
    robot: RobotBody,
    angles: FloatArray,
    *,
    mount: Mount,
    perturbation: Perturbation,
    scene: Scene | None = None,
    notify: Callable[[str], object] = lambda note: None,
) -> World:
    """Build the world of a robot with servo joints at `angles` (n,) rad and soles on the floor at the origin.

    notify: receives what is left out of the scene. Raises ConfigError for a robot without masses, gains, feet or hook,
    and without MuJoCo.
    """
    engine()
    check_gains(robot)
    check_mount(robot, mount)
    free = mount.support is not Support.STAND
    spec = body_spec(robot.profile.body_path, root="free" if free else "fixed")
    check_masses(robot, spec)
    drives = robot_drives(robot, stiffness_scale=perturbation.stiffness_scale)
    stance = plant(robot, dict(zip(robot.joint_map.joints, angles.tolist(), strict=True)))
    place = _placed(robot, stance, mount)
    base = _bare(spec)
    _set_options(spec)
    if not free:
        base.pos, base.quat = place.position, place.quat
    add_floor(spec, perturbation.friction)
    add_soles(spec, robot)
    if scene is not None:
        for name in add_fixtures(spec, scene, HERE if mount.support is Support.FLOOR else place):
            notify(f"{name} moves: it is not part of the physics")
    links = robot.body.body_names
    sort_shapes(spec, frozenset[str]().union(*robot.foot_links))
    add_motors(spec, drives)
    if mount.support is Support.FLOOR:
        add_hand(spec, base.name)
    if mount.support is Support.GANTRY:
        hook = robot.frame(mount.hook)
        at = stance.points[mount.hook] + np.array([0.0, 0.0, _lift(robot, mount)])
        add_rope(spec, links[hook.body], hook, at=at, length=mount.rope)
    _let_touching_shapes_be(spec, robot, drives)
    model = _compiled(spec, robot)
    return _world(robot, mount, model, drives, place=place, angles=angles, root=base.name)


def robot_drives(robot: RobotBody, *, stiffness_scale: float = 1.0) -> tuple[Drive, ...]:
    """The servos of a robot with motors and loops, in servo order; stiffness_scale: of the profile's
    stiffness."""
    return tuple(
        Drive(servo, drive_numbers(servo.model), position_loop(servo), stiffness_scale * loop_stiffness(servo))
        for servo in robot.joint_map.servos
    )


def _placed(robot: RobotBody, stance: Stance, mount: Mount) -> Pose:
    """The first pose of the root link: soles on the floor, or `lift` above it."""
    if robot.profile.root == "free":
        position, quat = stance.q[:3], stance.q[3:7]
    else:  # as the body file has it
        base = int(np.flatnonzero(robot.body.parent == 0)[1])
        position, quat = robot.body.body_pos[base], robot.body.body_quat[base]
    x, y, z = position.tolist()
    w, i, j, k = quat.tolist()
    return Pose((x, y, z + _lift(robot, mount)), (w, i, j, k))


def _lift(robot: RobotBody, mount: Mount) -> float:
    """The height of the start above standing, m. A body file with a fixed root has its height, unless stretched
    legs would touch the floor from there."""
    if mount.support is Support.FLOOR:
        return 0.0
    if robot.profile.root == "free":
        return mount.lift
    points = plant(robot, robot.profile.postures.stand).points
    lowest = min((float(points[foot.frame][2]) for foot in robot.profile.feet.values()), default=mount.lift)
    return max(mount.lift - lowest, 0.0)


def _bare(spec: Any) -> Any:
    """Remove actuators, sensors, cameras and world shapes from a body; name its links. Return the root link."""
    extras = (spec.actuators, spec.sensors, spec.worldbody.geoms, spec.cameras, spec.lights)
    for part in [part for parts in extras for part in list(parts)]:
        spec.delete(part)
    for index, link in enumerate(spec.bodies):
        link.name = link.name or f"body_{index}"
    return spec.worldbody.first_body()


def _set_options(spec: Any) -> None:
    mujoco = engine()
    option = spec.option
    option.timestep = STEP_S
    # Implicit in velocity: the servos' damping is too stiff for an explicit step of 2 ms.
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = IMPEDANCE_RATIO
    option.iterations, option.ls_iterations = ITERATIONS, LINE_ITERATIONS
    option.gravity = [0.0, 0.0, -GRAVITY]
    # One robot is one island. `Simulation` raises if it diverges, so there is no reset.
    for flag in ("mjDSBL_ISLAND", "mjDSBL_MIDPHASE", "mjDSBL_AUTORESET"):
        option.disableflags |= int(getattr(mujoco.mjtDisableBit, flag, 0))  # younger engines have more of them


def _let_touching_shapes_be(spec: Any, robot: RobotBody, drives: Sequence[Drive]) -> None:
    """Exclude pairs of links that the profile ignores, and those that touch in `neutral`, `stand` or `rest`."""
    mujoco = engine()
    model = _compiled(spec, robot)
    data = mujoco.MjData(model)
    postures = robot.profile.postures
    pairs = {frozenset(ignored.pair) for ignored in robot.profile.ignore_pairs}
    for posture in (postures.neutral, postures.stand, postures.rest):
        for drive in drives:
            data.qpos[model.joint(drive.servo.joint).qposadr[0]] = posture.get(drive.servo.joint, 0.0)
        mujoco.mj_forward(model, data)
        pairs |= {
            frozenset(model.body(model.geom_bodyid[geom]).name for geom in geoms)
            for geoms in data.contact.geom[data.contact.dist < 0.0]
        }
    known = {(link.bodyname1, link.bodyname2) for link in spec.excludes}
    for first, second in sorted(tuple(sorted(pair)) for pair in pairs if len(pair) == 2 and "world" not in pair):
        if (first, second) not in known and (second, first) not in known:
            spec.add_exclude(bodyname1=first, bodyname2=second)


def _compiled(spec: Any, robot: RobotBody) -> Any:
    try:
        return spec.compile()
    except (ValueError, RuntimeError) as error:
        raise ConfigError(
            "the body cannot be simulated",
            where=robot.body.source,
            found=" ".join(str(error).split()),
            next_step="Fix the body file: physics needs more of it than kinematics",
        ) from error


def _world(
    robot: RobotBody,
    mount: Mount,
    model: Any,
    drives: tuple[Drive, ...],
    *,
    place: Pose,
    angles: FloatArray,
    root: str,
) -> World:
    soles = tuple(robot.frame(foot.frame) for foot in robot.profile.feet.values())
    free = mount.support is not Support.STAND
    index = model.body(root).id
    start = np.array(model.qpos0)
    if free:
        start[:7] = (*place.position, *place.quat)
    for drive, angle in zip(drives, angles, strict=True):
        start[model.joint(drive.servo.joint).qposadr[0]] = angle
    scalar = [name for name, kind in zip(robot.body.joint_names, robot.body.joint_type, strict=True) if kind > 1]
    columns = np.array([model.joint(name).qposadr[0] for name in scalar], dtype=np.intp)
    feet = {link: number for number, foot in enumerate(robot.foot_links, 1) for link in foot}
    owners = np.array([_owner(model, geom, feet, hand_links(robot)) for geom in range(model.ngeom)])
    return World(robot, mount, model, drives, index, free, columns, soles, owners, start)


def hand_links(robot: RobotBody) -> frozenset[str]:
    """The links of a robot that follow the performer's hands."""
    hands = robot.landmark_frames(tuple(name for name in HAND_LANDMARKS if name in robot.profile.landmarks))
    return frozenset(robot.body.body_names[robot.frame(frame).body] for frame in hands)


def _owner(model: Any, geom: int, feet: Mapping[str, int], hands: Container[str]) -> int:
    name, link = model.geom(geom).name, model.body(model.geom_bodyid[geom]).name
    if name == FLOOR:
        return 0
    if name.startswith(FIXTURE):
        return World.FIXTURES
    if link in feet:
        return feet[link]
    return World.HANDS if link in hands else World.ROBOT
