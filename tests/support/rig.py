"""Stand-ins for both stages, so that the loop, the metrics and the files are tested without a solver."""

from collections.abc import Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from faulty_bus import FaultyBus
from followers import op3, performer
from hardware.arrays import TickArray
from hardware.bus import ServoGoals, ServoStates
from hardware.clock import VirtualClock
from hardware.guard import Guard
from retarget.frames import SensorSample
from retarget.human.reconstruction import Reconstructor
from retarget.human.samples import Clip, Playback, lay_on_ticks
from retarget.ik.support_polygon import plant
from retarget.ik.whole_body_stop import LONGEST_STOP_TICKS, StopPath
from retarget.model.human import Human, PostureReader, build_human
from retarget.model.human_dimensions import POINTS, proportional_dimensions
from retarget.model.robot import RobotBody
from retarget.robot.follower import Follower
from retarget.run.loop import Ending, Loop, Operator, RunObserver
from retarget.run.rest_trajectory import EndPlan
from retarget.run.run_result import RunResult, RunSetup
from retarget.run.supervisor import End, Supervisor
from retarget.run.tick import Machine
from retarget.safety.gate import Gate
from retarget.schema.performer import Performer, load_performer
from retarget.types import FloatArray, HumanPosture, RobotPosture


def five() -> Performer:
    return load_performer("five")


def short_clip(*, seconds: float = 0.4, rate_hz: float | None = 125.0, speed: float = 1.0, loop: bool = False) -> Clip:
    playback = Playback(speed=speed, end=seconds, loop=loop)
    return lay_on_ticks(performer(), performer=five(), playback=playback, rate_hz=rate_hz)


class StubReconstructor(Reconstructor):
    """Every sample is the same standing human, whose pelvis is where the head's sensor is."""

    hierarchy: Any = SimpleNamespace(solver=SimpleNamespace(capped=0))

    def __init__(self, human: Human) -> None:
        self.human = human
        self.calls: list[float] = []
        self._reader = PostureReader(human)
        self.resumed, self.off = 0, 0.0

    @property
    def away(self) -> float:
        return self.off

    def resume(self, speed: float = 1.0) -> None:
        self.resumed += 1

    def start(self, sample: SensorSample) -> HumanPosture:
        return self._made(sample)

    def step(self, sample: SensorSample, dt: float) -> HumanPosture:
        self.calls.append(dt)
        return self._made(sample)

    def _made(self, sample: SensorSample) -> HumanPosture:
        q = self.human.body.qpos0.copy()
        q[:3] = sample.position[sample.names.index("head")]
        return HumanPosture(q, POINTS, *self._reader.read(q), np.zeros(len(sample.names)), 0.0, (1.0, 0.0))


class StubFollower(Follower):
    """Joint angles by a script: tick -> rad (n,) from the standing posture. Landmarks are asked where they are."""

    hierarchy: Any = SimpleNamespace(solver=SimpleNamespace(capped=0))
    strategies: Any = None
    legs: Any = None

    def __init__(self, robot: RobotBody, script: FloatArray) -> None:
        self.robot = robot
        self.script = script
        self.tick = 0
        self.reseeded: list[FloatArray] = []
        self.overrides: list[float] = []
        self.returns: list[FloatArray] = []
        self.passed_s = 0.0
        self.stance = plant(robot, robot.profile.postures.stand)

    def start(self, human: HumanPosture) -> RobotPosture:
        self.tick = 0
        return self._made(0)

    def settle(self, human: HumanPosture, dt: float) -> RobotPosture | None:
        return None

    def resume(self) -> None:
        pass

    def step(self, human: HumanPosture, dt: float) -> RobotPosture:
        self.tick += 1
        return self._made(self.tick - 1)

    def set_speed_override(self, override: float) -> None:
        self.overrides.append(override)

    def stop(self, dt: float) -> StopPath | None:
        return None

    def return_to_stance(self, dt: float) -> FloatArray | None:
        return None

    def begin_return_to_stance(self, q: FloatArray, dt: float) -> None:
        self.returns.append(q[self.robot.servo_columns].copy())

    def pass_time(self, dt: float) -> None:
        self.passed_s += dt

    def reseed(self, q: FloatArray, velocity: FloatArray, *, rests: bool = True) -> None:
        self.reseeded.append(q[self.robot.servo_columns].copy())

    def _made(self, tick: int) -> RobotPosture:
        q = self.stance.q.copy()
        q[self.robot.servo_columns] += self.script[min(tick, len(self.script) - 1)]
        names = tuple(self.robot.profile.landmarks)
        points = self.robot.points(q[None], self.robot.landmark_frames(names))[0]
        return RobotPosture(
            q=q,
            joint_positions=q[self.robot.servo_columns].copy(),
            root_position=q[:3],
            root_quaternion=q[3:7],
            landmark_names=names,
            landmarks_asked=points,
            landmarks_reached=points,
            centre_of_mass=np.zeros(3),
            observer_modes=np.zeros(0, dtype=np.uint8),
        )


def gentle_stop(robot: RobotBody, before: FloatArray, q: FloatArray, dt: float) -> StopPath:
    """From posture q (nq,), to which the robot got from `before` (nq,), all joints brake at a fifth of their
    deceleration."""
    columns, slower = robot.servo_columns, 0.2 * robot.joint_map.max_acceleration * dt**2
    postures, moved = [q], (q - before)[columns]
    while moved.any() and len(postures) <= LONGEST_STOP_TICKS:
        moved = np.copysign(np.maximum(np.abs(moved) - slower, 0.0), moved)
        q = q.copy()
        q[columns] += moved
        postures.append(q)
    return StopPath(np.array(postures))


class NotedBus(FaultyBus):
    """A bus that notes when it is read, s, and the goals (n,) that reach it, ticks; the first of both is at arming."""

    read_at: list[float]
    written: list[TickArray]

    def open(self) -> None:
        self.read_at, self.written = [], []
        super().open()

    def read(self) -> ServoStates:
        self.read_at.append(self._clock.now())
        return super().read()

    def write(self, goals: ServoGoals) -> None:
        super().write(goals)
        self.written.append(goals.ticks)


class Rig:
    """OP3 on a mock bus with a scripted follower."""

    def __init__(self, script: FloatArray, *, goes_to_rest: bool = False, **bus_options: object) -> None:
        """goes_to_rest: a stop ends in the profile's rest posture."""
        self.robot = op3()
        self.clock = VirtualClock()
        self.dt = 1.0 / self.robot.profile.safety.rate_hz
        stand = self.robot.posture(self.robot.profile.postures.stand)[self.robot.servo_columns]
        start = self.robot.joint_map.to_ticks(stand)
        self.bus = NotedBus(self.robot.joint_map.servos, self.clock, start=start, **bus_options)  # type: ignore[arg-type]
        self.bus.open()
        self.gate = Gate(self.robot.joint_map, dt=self.dt)
        self.guard = Guard(bus=self.bus, joint_map=self.robot.joint_map)
        self.follower = StubFollower(self.robot, script)
        self.notes: list[str] = []
        self.supervisor = Supervisor()
        self.machine = Machine(
            robot=self.robot,
            follower=self.follower,
            gate=self.gate,
            guard=self.guard,
            supervisor=self.supervisor,
            clock=self.clock,
            dt=self.dt,
            end_plan=EndPlan(End.AT_REST) if goes_to_rest else EndPlan(),
            waits=False,
            notify=self.notes.append,
        )

    def loop(
        self, clip: Clip | None = None, operator: Operator | None = None, observers: Sequence[RunObserver] = ()
    ) -> Loop:
        """A run of a clip; None: 0.4 s of the synthetic performer."""
        clip = short_clip(seconds=0.4) if clip is None else clip
        return Loop(self.machine, clip, StubReconstructor(person()), operator or Operator(), observers)


@cache
def person() -> Human:
    return build_human(proportional_dimensions(1.7))


def result(ending: Ending, clip: Clip, human: Human, robot: RobotBody | None) -> RunResult:
    return RunResult(
        record=ending.record,
        clip=clip,
        human=human,
        robot=robot,
        setup=RunSetup(five(), (), has_bus=robot is not None),
        state=None if ending.state is None else ending.state.value,
        reason=ending.reason,
        wall_s=ending.wall_s,
    )


def scripted_run() -> RunResult:
    """A short run of an OP3, one joint of which turns by 0.02 rad."""
    script = np.zeros((51, 20))
    script[:, 1] = np.linspace(0.0, 0.02, 51)
    rig, human, clip = Rig(script), person(), short_clip()
    ending = rig.loop(clip).run()
    return result(ending, clip, human, rig.robot)


def play(rig: Rig, operator: Operator | None = None, *observers: RunObserver) -> Ending:
    return rig.loop(None, operator, observers).run()
