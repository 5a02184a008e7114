"""Load and check a run; errors are raised before anything moves or is written."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf

import numpy as np

from hardware.bus import ServoBus
from hardware.clock import Clock, VirtualClock
from hardware.guard import Guard
from hardware.servo import loop_lag
from retarget.errors import UsageError
from retarget.frames import SensorFrames
from retarget.human.calibration import calibrate
from retarget.human.reconstruction import Reconstructor
from retarget.human.samples import Parts, Performance, Playback, Samples, lay_on_ticks
from retarget.human.sensor_intake import IntakeTimes
from retarget.ik.hierarchy import SceneObstacles
from retarget.model.human import Human, build_human
from retarget.model.observers import Observers, contacts
from retarget.model.robot import TRUNK, RobotBody, load_robot
from retarget.model.scene_state import SceneState
from retarget.robot.balance import moving_share, support_tasks
from retarget.robot.deflection_compensation import DeflectionCompensation
from retarget.robot.follower import Follower
from retarget.robot.landmarks import standing_dofs
from retarget.robot.reach_map import map_path
from retarget.robot.walking.gait import gait_of, with_steps
from retarget.robot.walking.travel import WalkTally
from retarget.robot.walking.walking_goals import WalkingGoals
from retarget.run.loop import Ending, Inputs, Loop, Operator, RunObserver, run_human
from retarget.run.options import RunOptions, name_with_mass, priority_names
from retarget.run.performers import RecordedPerformer
from retarget.run.rest_trajectory import EndPlan, plan_end
from retarget.run.run_result import CAPPED, RunResult, RunSetup, RunTally
from retarget.run.supervisor import Supervisor
from retarget.run.tick import Machine
from retarget.safety.clearance import PathClearance, refuse_contact, refuse_floor
from retarget.safety.contact import ContactDetector
from retarget.safety.force_limit import with_max_force
from retarget.safety.gate import Compensation, Gate, PassThroughGate
from retarget.safety.standing import StandingCheck
from retarget.safety.tipping import TipWatch
from retarget.schema.catalogue import Kind, entries
from retarget.schema.performer import Performer, load_performer
from retarget.schema.priorities import Priorities, check_for_human, load_priorities, naming_file
from retarget.schema.scene import load_scene, on_floor
from retarget.types import News, Notify


def make_gate(robot: RobotBody, follower: Follower, priorities: Priorities, options: RunOptions, *, dt: float) -> Gate:
    """The gate of a robot in ticks of `dt` s, by the options."""
    servos, caps = robot.joint_map, robot.profile.safety.speed_caps
    standing = StandingCheck(robot, follower.stance, dt=dt)
    if not options.gate:
        return PassThroughGate(servos, dt=dt, standing=standing)
    observers, settings = follower.hierarchy.observers, priorities.deflection_compensation
    clearance = None if observers is None else PathClearance(robot, observers, follower.scene_obstacles, dt=dt)
    compensation: Compensation | None = None
    if settings is not None and follower.stance.soles:
        compensation = holds = DeflectionCompensation(robot, follower.stance, dt=dt, settle=settings.settle)
        if follower.legs is not None:
            gait = gait_of(robot, follower.stance, dt=dt)
            compensation = WalkingGoals(robot, follower.stance, holds, gait) if options.has_mass else None
    speed = max(caps.follow, caps.approach)
    return Gate(servos, dt=dt, speed=speed, clearance=clearance, standing=standing, compensation=compensation)


def robot_stage(
    robot: RobotBody, priorities: Priorities, human: Human, options: RunOptions, scene: SceneState | None, *, dt: float
) -> tuple[Follower, Gate]:
    """The follower and the gate. Raises UsageError if the robot touches the scene, ConfigError for unknown names of the
    priorities."""
    with naming_file(priority_names(robot, options)[-1], robot=robot.profile.name):
        follower = Follower(
            robot, priorities, human.dimensions, parts=options.parts, iterations=options.iterations, scene=scene
        )
    if not options.allow_contact:
        touching = contacts(robot.body, follower.observers, scene, follower.stance.q)
        refuse_contact(touching, where=f"{robot.profile.name}, standing")
        if scene is not None:
            refuse_floor(robot, follower.observers, scene, follower.stance.q)
    return follower, make_gate(robot, follower, priorities, options, dt=dt)


def robot_part(
    robot: RobotBody,
    priorities: Priorities,
    human: Human,
    options: RunOptions,
    scene: SceneState | None,
    *,
    dt: float,
    goes_to_rest: bool | None = None,
    end_plan: EndPlan | None = None,
) -> tuple[Follower, Gate, EndPlan]:
    """The robot's stage, and the end of the run; see `prepare_for`."""
    follower, gate = robot_stage(robot, priorities, human, options, scene, dt=dt)
    if end_plan is None and not robot.floats and (options.has_mass if goes_to_rest is None else goes_to_rest):
        tried = make_gate(robot, follower, priorities, options, dt=dt)
        end_plan = plan_end(robot, follower.stance, tried, options, dt=dt)
    return follower, gate, end_plan or EndPlan()


MakeBus = Callable[[RobotBody, Clock], ServoBus]
"""From a robot to its bus."""

Perform = Callable[[Performer, RobotBody | None], Performance]
"""From the performer and the robot, if any, to the performance."""


def _ignore(text: str) -> None:
    """Drop the message."""


def _notify_all(notes: Iterable[str], notify: Notify) -> None:
    for note in notes:
        notify(News(f"note: {note}"))


@dataclass(frozen=True, eq=False)
class Prepared:
    """A run that can start."""

    samples: Samples
    human: Human
    performer: Performer
    reconstructor: Reconstructor
    machine: Machine | None
    priorities: tuple[Priorities, ...]
    has_bus: bool
    notes: tuple[str, ...]
    clock: Clock
    scene: SceneState | None = None
    observers: Observers | None = None
    intake: IntakeTimes = field(default_factory=IntakeTimes)
    scene_obstacles: SceneObstacles | None = None
    walk: Callable[[], WalkTally] | None = None
    parts: Parts = "whole"

    def loop(
        self, operator: Operator | None = None, observers: Sequence[RunObserver] = (), inputs: Inputs | None = None
    ) -> Loop:
        """The loop of a run. Raises RetargetError if the posture to approach is not finite."""
        assert self.machine is not None, "a human alone has no loop of a robot"
        return Loop(self.machine, self.samples, self.reconstructor, operator or Operator(), observers, inputs)

    def run(
        self, operator: Operator | None = None, observers: Sequence[RunObserver] = (), inputs: Inputs | None = None
    ) -> RunResult:
        """Run it; see `Loop`. Raises GuardError or BusError if the robot cannot be armed."""
        if self.machine is None:
            operator = operator or Operator()
            return self.result(run_human(self.samples, self.reconstructor, operator, self.clock, observers))
        return self.result(self.loop(operator, observers, inputs).run())

    def result(self, ending: Ending) -> RunResult:
        """The run, for metrics, pictures and files."""
        machine, strategies = self.machine, None
        if machine is not None and machine.follower.strategies is not None:
            strategies = {one.value: seconds for one, seconds in machine.follower.strategies.seconds.items()}
        notes = self.notes + ending.record.missing() + ending.too_slow + self._capped()
        return RunResult(
            record=ending.record,
            clip=self.samples.recorded(),
            human=self.human,
            robot=None if machine is None else machine.robot,
            setup=RunSetup(
                self.performer,
                self.priorities,
                self.has_bus,
                real_time=not isinstance(self.clock, VirtualClock),
                parts=self.parts,
            ),
            state=None if ending.state is None else ending.state.value,
            reason=ending.reason,
            wall_s=ending.wall_s,
            notes=notes if machine is None or ending.standing else notes + machine.not_at_rest(),
            stop=None if machine is None else machine.guard.stop,
            scene=self.scene,
            observers=self.observers,
            tally=RunTally(
                walk=None if self.walk is None else self.walk(),
                refused_pair=None if machine is None else machine.refused_pair,
                presses=None if machine is None or machine.contact is None else machine.contact.presses,
                standing=ending.standing,
                strategies=strategies,
            ),
        )

    def _capped(self) -> tuple[str, ...]:
        capped = self.reconstructor.hierarchy.solver.capped
        if self.machine is not None:
            capped += self.machine.follower.hierarchy.solver.capped
        if not capped:
            return ()
        return (f"{capped} {CAPPED}",)


def performance_of(read: Callable[[], SensorFrames], playback: Playback, *, rate_hz: float | None = None) -> Perform:
    """A recorded performance. read: opens the recording. rate_hz: of the ticks; None: the robot's, else the
    recording's."""

    def perform(performer: Performer, robot: RobotBody | None) -> Performance:
        frames = read()
        rate = rate_hz if robot is None or rate_hz is not None else robot.profile.safety.rate_hz
        clip = lay_on_ticks(frames, performer=performer, playback=playback, rate_hz=rate)
        size = calibrate(frames.mirror() if playback.mirror else frames)
        left_out = () if clip.left_out is None else (f"{frames.source} {clip.left_out}",)
        if clip.with_jumps is None:
            return Performance(clip, size, frames.notes + left_out)
        names = ", ".join(clip.names_of_jumped)
        jumps = f"{frames.source}: {names} jumped farther than a human can; there the performer is not followed"
        return Performance(RecordedPerformer(clip), size, (*frames.notes, *left_out, jumps))

    return perform


def prepare(
    read: Callable[[], SensorFrames],
    options: RunOptions,
    *,
    clock: Clock,
    make_bus: MakeBus,
    goes_to_rest: bool | None = None,
    notify: Notify = _ignore,
) -> AbstractContextManager[Prepared]:
    """Prepare a run of a recorded performance, see `prepare_for`."""
    perform = performance_of(read, options.playback)
    return prepare_for(perform, options, clock=clock, make_bus=make_bus, goes_to_rest=goes_to_rest, notify=notify)


@contextmanager
def prepare_for(
    perform: Perform,
    options: RunOptions,
    *,
    clock: Clock,
    make_bus: MakeBus,
    goes_to_rest: bool | None = None,
    end_plan: EndPlan | None = None,
    notify: Notify = _ignore,
    robot: RobotBody | None = None,
    has_deadlines: bool | None = None,
    supervisor: Supervisor | None = None,
) -> Iterator[Prepared]:
    """Load and check a run, small files first; the bus is open within the context. Raises RetargetError.

    goes_to_rest: end at rest or standing (see `plan_end`), else braked; None: if the robot has mass. has_deadlines: a
    late tick stops the robot; None: on a real bus, as simulated servos wait. supervisor: of a performer who was
    measured first.
    """
    performer = load_performer(options.performer_name)
    if robot is None and not options.is_human:
        robot = load_robot(options.robot, root=options.root)
    if robot is not None and options.max_force is not None:
        robot = with_max_force(robot, options.max_force)
    for_human, for_robot, on_priorities = stage_priorities(robot, options)
    scene = scene_of(robot, options)
    of_robot = () if robot is None else (*robot.body.notes, *on_priorities)
    if robot is not None and not options.gate:
        of_robot = (*of_robot, "--no-gate: no goal was checked, and a real robot could hit itself")
    _notify_all(of_robot, notify)  # before a performer gets into the pose
    human = _human(perform(performer, robot), performer, for_human, options, clock, scene if robot is None else None)
    _notify_all(human.notes, notify)
    if robot is None or for_robot is None:
        yield human
        return
    dt = human.samples.dt
    bus = make_bus(robot, clock)
    follower, gate, end_plan = robot_part(
        robot, for_robot, human.human, options, scene, dt=dt, goes_to_rest=goes_to_rest, end_plan=end_plan
    )
    of_follower = tuple(filter(None, (follower.note,)))
    _notify_all(of_follower, notify)
    real = not options.simulated
    watch = TipWatch(robot, dt=dt) if robot.stands and robot.profile.imu is not None else None
    if real and end_plan.why:  # the operator has to be there at the end
        notify(f"note: at the end it stands, with torque, until you hold it and switch torque off: {end_plan.why}")
    lag = tuple(loop_lag(servo) for servo in robot.joint_map.servos)
    limits = replace(robot.profile.safety.guard_limits(), lag=lag, limbs=limbs_of(robot))
    has_deadlines = real if has_deadlines is None else has_deadlines
    limits = limits if has_deadlines else replace(limits, max_pause=inf)
    guard, supervisor = Guard(bus=bus, joint_map=robot.joint_map, limits=limits), supervisor or Supervisor()
    contact = None
    if options.has_mass and robot.profile.safety.holds_when_pressed:
        contact = ContactDetector(robot, dt=dt)
    machine = Machine(
        robot, follower, gate, guard, supervisor, clock, dt, end_plan, real, notify, tip_watch=watch, contact=contact
    )
    prepared = replace(
        human,
        machine=machine,
        priorities=(for_human, for_robot),
        has_bus=options.bus != "none",
        parts=options.parts,
        notes=(*of_robot, *human.notes, *of_follower),
        scene=scene,
        observers=follower.observers,
        scene_obstacles=follower.scene_obstacles,
        walk=None if follower.legs is None else follower.legs.tally,
    )
    with _open(bus, guard):
        yield prepared


@contextmanager
def _open(bus: ServoBus, guard: Guard) -> Iterator[None]:
    bus.open()
    failed = True
    try:
        yield
        failed = guard.stop is not None
    finally:
        # A failure is in the run's result or is being raised; closing the bus must not replace it.
        with suppress(Exception) if failed else nullcontext():
            bus.close()


def _human(
    performance: Performance,
    performer: Performer,
    priorities: Priorities,
    options: RunOptions,
    clock: Clock,
    scene: SceneState | None,
) -> Prepared:
    """The human stage alone. scene: of a run without a robot."""
    samples, human = performance.samples, build_human(performance.dimensions)
    reconstruct = partial(Reconstructor, human, priorities, performer, iterations=options.iterations, scene=scene)
    reconstructor = reconstruct(intake=performance.intake)
    if scene is not None and reconstructor.observers is None:
        raise UsageError(
            "the human has no observers for a scene",
            where="--scene",
            found=f"priority file {priorities.name}",
            allowed="a priority file with observers: {human: lines, lines_and_head or capsules}",
        )
    if scene is not None and not options.allow_contact:
        # A reconstructor of its own keeps the check from changing the run.
        checked, sample = reconstruct(), samples.sample(0)
        assert sample is not None and checked.observers is not None, "the first sample is valid"
        start = checked.start(sample).q
        without_self = replace(checked.observers, pairs=np.zeros((0, 2), dtype=np.int64))
        refuse_contact(contacts(human.body, without_self, scene, start), where="human, first posture")
    return Prepared(
        samples=samples,
        human=human,
        performer=performer,
        reconstructor=reconstructor,
        machine=None,
        priorities=(priorities,),
        has_bus=False,
        notes=performance.notes,
        clock=clock,
        scene=scene,
        observers=reconstructor.observers,
        intake=performance.intake,
        scene_obstacles=reconstructor.scene_obstacles,
    )


def scene_of(robot: RobotBody | None, options: RunOptions) -> SceneState | None:
    """The scene of the options, with a floor under a robot with feet."""
    scene = None if options.scene is None else load_scene(options.scene)
    if robot is not None and robot.on_floor:
        scene = on_floor(scene)
    return None if scene is None else SceneState(scene)


def stage_priorities(
    robot: RobotBody | None, options: RunOptions
) -> tuple[Priorities, Priorities | None, tuple[str, ...]]:
    """The priority files of both stages, and notes about the robot's."""
    first, *others = priority_names(robot, options)
    if robot is None:
        of_human = _load_priorities(first, "--priorities")
        check_for_human(of_human, first)
        return of_human, None, ()
    [last], profile = others, robot.profile
    by = f"in the profile of {profile.name}"
    key = f"{'retarget' if last == profile.retarget else 'standing'} {by}"
    of_human = _load_priorities(first, f"reconstruct {by}")
    of_robot = _load_priorities(last, key if options.priorities is None else "--priorities")
    of_robot, notes = with_steps(of_robot, robot, options.steps, parts=options.parts, mass=options.has_mass)
    if of_robot.strategies and robot.stands and not map_path(robot, of_robot).is_file():
        notes = (*notes, f"which hand places {profile.name} reaches is measured, once; it takes a minute or more")
    usual, balances = name_with_mass(robot), bool(support_tasks(of_robot))
    if robot.stands and last != usual and (not balances or (options.has_mass and moving_share(of_robot) is None)):
        how = f"balances {profile.name} as if it stood still" if balances else f"does not balance {profile.name}"
        name = of_robot.name
        with_mass = next((one.name for one in entries(Kind.PRIORITIES) if one.name == f"balanced_{name}"), usual)
        notes = (*notes, f"{name} {how}, so it may fall. Use {with_mass}, or extend it")
    return of_human, of_robot, notes


def _load_priorities(name: str, named_by: str) -> Priorities:
    """The priority file; the error for an unknown name adds the key that names it."""
    try:
        return load_priorities(name)
    except UsageError as error:
        problems = [problem if problem.where else replace(problem, where=named_by) for problem in error.problems]
        raise UsageError.from_problems(problems) from error


def limbs_of(robot: RobotBody) -> tuple[bool, ...]:
    """Mask, servo order, of servos of arms or head alone, without which the robot stands; empty if it does not stand. A
    coupled servo belongs to both joints."""
    if not robot.stands:
        return ()
    carrying = standing_dofs(robot, TRUNK)
    servos = robot.joint_map.servos
    moved = [(servo.joint,) if servo.coupling is None else servo.coupling.joints for servo in servos]
    return tuple(not any(carrying[robot.body.dof_index(joint)] for joint in joints) for joints in moved)
