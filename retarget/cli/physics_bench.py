"""The bench of a run: its bus, and where the robot has mass, who watches it, troubles it and stops it after a fall."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from hardware.bus import ServoBus
from hardware.clock import Clock
from hardware.guard_state import StopCause
from retarget.body import JointType
from retarget.cli.buses import make_bus, standing_ticks
from retarget.errors import UsageError
from retarget.options import RunOptions
from retarget.prepare import Prepared
from retarget.record import Phase
from retarget.robot_body import RobotBody, load_robot
from retarget.rotations import FloatArray
from retarget.run_result import RunResult
from retarget.scene import load_scene
from retarget.standing import check_stand
from retarget.viewer.beside import Truth

if TYPE_CHECKING:
    from sim.physics.bus import PhysicsBus
    from sim.physics.mount import Mount
    from sim.physics.witnessed_bus import WitnessedBus

__all__ = ["AFTER_FALL_S", "PhysicsBench"]

AFTER_FALL_S = 1.0
"""So long a run goes on after a fall, s."""
LIVE_PUSH_S = 30.0
"""Within this time of a live performance a push comes, s; of a recording, within its length."""
CHEST = "chest"
"""The frame that is pushed, where the profile has it; else the centre of mass of the root link."""

Tell = Callable[[str], object]


class PhysicsBench:
    """Of one run. Without physics it only makes the bus. tell: hears of what the simulation leaves out."""

    def __init__(self, options: RunOptions, tell: Tell) -> None:
        self._options, self._tell = options, tell
        self._bus: PhysicsBus | WitnessedBus | None = None
        self._robot: RobotBody
        self._to_push = "push" in options.physics.trouble

    def make_bus(self, robot: RobotBody, clock: Clock) -> ServoBus:
        """The bus that the options name. Raises RetargetError."""
        options = self._options
        if not options.has_physics:
            return make_bus(options.bus, robot, clock, faults=options.faults)
        self._bus = self._physics_bus(robot, clock)
        return self._bus

    def watching(self, stop_asked: Callable[[], bool], prepared: Prepared, *, live: bool = False) -> Callable[[], bool]:
        """What is to be asked before every tick instead of `stop_asked`: it stops the run after a fall, too."""
        if self._bus is None or prepared.side is None:
            return stop_asked
        side, samples = prepared.side, prepared.samples
        witness, within = self._bus.witness, LIVE_PUSH_S if live else samples.ticks * samples.dt

        def asked() -> bool:
            fall, now = witness.fall, witness.simulation.time
            if self._to_push and side.phase is Phase.FOLLOW:
                self._push(now, within)
            if fall is not None and now >= fall.time + AFTER_FALL_S and side.following:
                side.guard.stop(f"the robot has fallen: {fall.how}", StopCause.FALLEN)
            return stop_asked()

        return asked

    def seen(self, run: RunResult) -> RunResult:
        """A run with what the simulation saw of it; to be called when the bus is closed."""
        if self._bus is None:
            return run
        from sim.physics.outcome import physics_run

        asked, time = self._options.physics, run.record.time
        begun = float(time[0]) if len(time) else 0.0
        return replace(run, physics=physics_run(self._bus.witness, begun=begun, seed=asked.seed, trouble=asked.trouble))

    def truth(self) -> Truth | None:
        """Where the simulated body was when its servos were read last; None without physics."""
        if self._bus is None:
            return None
        state, body = self._bus.witness.state, self._robot.body
        return Truth(state.root, state.q[body.joint_qpos[body.joint_type > JointType.BALL]], state.zmp)

    def truth_numbers(self) -> FloatArray | None:
        """The same as numbers, for a recording."""
        truth = self.truth()
        return None if truth is None else truth.numbers()

    def _physics_bus(self, robot: RobotBody, clock: Clock) -> "PhysicsBus | WitnessedBus":
        from sim.physics.mount import mount_of
        from sim.physics.perturbation import combined, drawn, trouble_of
        from sim.physics_bus import physics_bus, physics_wire_bus, simulation_of

        options, asked = self._options, self._options.physics
        if asked.root is not None:  # it follows as it is held; its soles are still soles
            robot = load_robot(options.robot)
        self._robot = robot
        mount = self._mount(robot) or mount_of(robot)
        if mount.support.value == "floor":
            check_stand(robot)
        steady = [drawn(trouble_of(name), asked.seed, within=(0.0, 0.0)) for name in asked.trouble if name != "push"]
        simulation = simulation_of(
            robot,
            start=standing_ticks(robot),
            scene=None if options.scene is None else load_scene(options.scene),
            mount=mount,
            perturbation=combined(steady),
            seed=asked.seed,
            tell=self._note,
        )
        if options.bus == "physics":
            return physics_bus(simulation, clock)
        return physics_wire_bus(simulation, clock, faults=options.faults, tell=self._note)

    def _mount(self, robot: RobotBody) -> "Mount | None":
        """What was asked for; None: as the profile says."""
        from sim.physics.mount import Mount, Support, mount_of

        asked = self._options.physics
        if asked.mount is None and asked.hook is None:
            return None
        mount = mount_of(robot) if asked.mount is None else Mount(Support(asked.mount))
        if asked.hook is None:
            return mount
        if mount.support is not Support.GANTRY:
            raise UsageError("only a gantry has a hook", where="--hook", found=f"on the {mount.support.value}")
        return replace(mount, hook=asked.hook)

    def _push(self, now: float, within: float) -> None:
        """Let the push come at some time of the performance, which begins now; once."""
        from sim.physics.perturbation import Trouble, drawn

        assert self._bus is not None
        self._to_push = False
        frame = CHEST if CHEST in self._robot.profile.frames else None
        later = (now + 0.1 * within, now + 0.9 * within)
        for push in drawn(Trouble.PUSH, self._options.physics.seed, within=later, frame=frame).pushes:
            self._bus.witness.simulation.push(push)

    def _note(self, text: str) -> None:
        self._tell(f"note: {text}")
