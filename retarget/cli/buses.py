"""The bus that `--bus` names: servos of this process, an emulated wire, simulated mechanics, or real servos."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hardware.arrays import TickArray
from hardware.bus import ServoBus
from hardware.clock import Clock
from hardware.guard_state import StopCause
from hardware.no_bus import NoBus
from retarget.cli.application import note
from retarget.errors import UsageError
from retarget.human.samples import Samples
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.support_polygon import check_stand
from retarget.live.performer import LivePerformer
from retarget.model.body import JointType
from retarget.model.robot import RobotBody, load_robot
from retarget.run.options import RunOptions, perturbation_of
from retarget.run.own_bus import OwnBus, is_own, own_bus_class
from retarget.run.run_result import RunResult
from retarget.run.tick import Machine
from retarget.safety.force_limit import with_max_force
from retarget.schema.scene import load_scene
from retarget.types import FloatArray, News, Notify, RunState

if TYPE_CHECKING:
    from sim.physics.mount import Mount
    from sim.physics.witness import WitnessedBus


def make_bus(
    name: str, robot: RobotBody, clock: Clock, *, faults: Path | None = None, posture: str = "stand"
) -> ServoBus:
    """Make the bus of this name, user's class or port. Simulated servos begin in this posture. Raises RetargetError."""
    from sim.mock_bus import mock_bus

    match name:
        case "none":
            return NoBus(clock, start=posture_ticks(robot, posture))
        case "mock":
            return mock_bus(robot, clock, start=posture_ticks(robot, posture))
        case "emulator":
            from sim.buses import emulated_bus

            return emulated_bus(robot, clock, start=posture_ticks(robot, posture), faults=faults)
    if is_own(name):
        return OwnBus(name, robot, clock)
    from hardware.dynamixel.bus import DynamixelBus
    from hardware.dynamixel.serial_port import SerialPort

    buses, imu = robot.profile.bus_specs(), robot.profile.imu_spec()
    if name != "profile" and len(buses) > 1:
        raise UsageError(
            "one port for a robot with several buses",
            where="--bus",
            found=name,
            allowed=f"profile, which takes the ports of {', '.join(bus.name for bus in buses)}",
            next_step="Write the ports into the profile",
        )
    if name != "profile":
        buses = tuple(replace(bus, port=name) for bus in buses)
    return DynamixelBus(robot.joint_map, buses, lambda bus: SerialPort(bus.port, clock), imu=imu, notify=note)


def check_bus(name: str) -> None:
    """Raise UsageError for a class of the user that is no bus. Other names are checked when the bus is opened."""
    if is_own(name):
        own_bus_class(name)


def posture_ticks(robot: RobotBody, name: str = "stand") -> TickArray:
    """A posture of the profile, ticks (n,)."""
    return robot.joint_map.to_ticks(robot.posture(getattr(robot.profile.postures, name))[robot.servo_columns])


# The bench of a run: its bus and, of simulated mechanics, perturbations and the stop after a fall.

AFTER_FALL_S = 1.0
"""Time, s, of a run after a fall."""
LIVE_PUSH_S = 30.0
"""Time, s, of a live performance within which a push comes."""
CHEST = "chest"
"""The frame that is pushed; without it, the centre of mass of the root link."""


class PhysicsBench:
    """The bench of one run. Without physics it only makes the bus. notify: receives notes of the simulation."""

    def __init__(self, options: RunOptions, notify: Notify) -> None:
        """Raises UsageError for a class that is no bus."""
        self._options, self._notify = options, notify
        check_bus(options.bus)
        self._bus: WitnessedBus | None = None
        self._robot: RobotBody
        self._to_push = "push" in options.physics.perturbations
        self._may_topple = False  # at rest, when torque goes off

    def make_bus(self, robot: RobotBody, clock: Clock) -> ServoBus:
        """Make the bus of the options. Raises RetargetError."""
        options = self._options
        self._may_topple = options.has_mass and robot.stands and not robot.profile.postures.stays_at_rest
        if not options.has_physics:
            return make_bus(options.bus, robot, clock, faults=options.faults)
        self._bus = self._physics_bus(robot, clock)
        return self._bus

    @property
    def may_topple(self) -> bool:
        """True if the robot may fall when torque goes off at the end of the run."""
        return self._may_topple and self._options.torque_off_at_end

    def look(self, machine: Machine, samples: Samples) -> tuple[StopCause, str] | None:
        """Look at the simulation, once a tick. Returns the reason for which a robot that has fallen stops."""
        if self._bus is None:
            return None
        fall, now = self._bus.witness.fall, self._bus.witness.simulation.time
        if self._to_push and machine.supervisor.state is RunState.FOLLOW:
            # One push, at a random time of the performance, which begins now.
            from sim.physics.perturbation import PerturbationKind, drawn

            self._to_push = False
            within = LIVE_PUSH_S if isinstance(samples, LivePerformer) else samples.ticks * samples.dt
            frame = CHEST if CHEST in self._robot.profile.frames else None
            later, seed = (now + 0.1 * within, now + 0.9 * within), self._options.physics.seed
            for push in drawn(PerturbationKind.PUSH, seed, within=later, frame=frame).pushes:
                self._bus.witness.simulation.push(push)
        if fall is not None and now >= fall.time + AFTER_FALL_S and machine.guard.may_go_to_rest:
            return StopCause.FALLEN, f"the robot has fallen: {fall.how}"
        return None

    def hang(self, mass: float, frame: str) -> None:
        """Hang an object, kg, at a frame of the simulated robot. A real robot carries it already."""
        if self._bus is not None:
            from sim.physics.perturbation import Push

            self._bus.witness.simulation.push(Push((0.0, 0.0, -GRAVITY * mass), 0.0, 1e6, frame))

    def seen(self, run: RunResult) -> RunResult:
        """Add the measurements of the simulation to a run whose bus is closed."""
        if self._bus is None:
            return run
        from sim.physics.witness import physics_run

        options, time = self._options.physics, run.record.time
        begun = float(time[0]) if len(time) else 0.0
        kinds = options.perturbations
        measured = physics_run(self._bus.witness, begun=begun, seed=options.seed, perturbations=kinds)
        return replace(run, physics=measured)

    def truth(self) -> FloatArray | None:
        """The state of the simulated body when its servos were read last, m and rad (see `truth_names`), or None."""
        if self._bus is None:
            return None
        state, body = self._bus.witness.state, self._robot.body
        return np.concatenate([state.root, state.q[body.joint_qpos[body.joint_type > JointType.BALL]], state.zmp])

    def _physics_bus(self, robot: RobotBody, clock: Clock) -> "WitnessedBus":
        from sim.buses import physics_bus, physics_wire_bus, simulation_of
        from sim.physics.perturbation import PerturbationKind, combined, drawn

        options, physics = self._options, self._options.physics

        def notify(text: str) -> None:
            self._notify(News(f"note: {text}"))

        if physics.root is not None:  # it follows with the root of its mount, and still has soles
            robot = load_robot(options.robot)
            robot = robot if options.max_force is None else with_max_force(robot, options.max_force)
        self._robot = robot
        mount = self._mount(robot)
        if mount.support.value == "floor":
            check_stand(robot)
        constant = [perturbation_of(text) for text in physics.perturbations if text != "push"]
        seed = physics.seed
        perturbed = [drawn(PerturbationKind(kind), seed, within=(0, 0), value=value) for kind, value in constant]
        simulation = simulation_of(
            robot,
            start=posture_ticks(robot),
            scene=None if options.scene is None else load_scene(options.scene),
            mount=mount,
            perturbation=combined(perturbed),
            seed=seed,
            notify=notify,
        )
        if options.bus == "physics":
            return physics_bus(simulation, clock)
        return physics_wire_bus(simulation, clock, faults=options.faults, notify=notify)

    def _mount(self, robot: RobotBody) -> "Mount":
        from sim.physics.mount import Mount, Support, mount_of

        physics = self._options.physics
        mount = mount_of(robot) if physics.mount is None else Mount(Support(physics.mount))
        if physics.hook is None:
            return mount
        if mount.support is not Support.GANTRY:
            raise UsageError("only a gantry has a hook", where="--hook", found=f"on the {mount.support.value}")
        return replace(mount, hook=physics.hook)
