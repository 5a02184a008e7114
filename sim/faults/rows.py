"""The rows of the fault table, read from `rows.yaml`: what is injected, what a robot must do, and when.

Injections act on a bench: on its sender, host, bus and servos. The table names them.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import yaml

from hardware.guard import CheckedGoal
from hardware.guard_state import StopCause
from retarget.live.admission import Datagram
from retarget.types import FloatArray, RobotPosture, RunState
from sim.emulator.faults import Fault, FaultKind
from sim.faults import sender
from sim.faults.bench import BEFORE_ARMING, Bench
from sim.faults.sender import encoded
from sim.physics.perturbation import Push

HELD_S = 0.150
"""Longest time from silence of the stream to the hold, s."""


class Reaction(Enum):
    """The required reaction of a moving robot."""

    NONE = "goes on"
    MAY_HOLD = "goes on, or holds"
    OUT = "the sensor takes no part"
    HOLD = "holds: brakes and stands, torque on"
    RESUME = "holds, and goes on by itself"
    REBASE = "follows the new clock"
    STAND = "brakes and stands, torque on"
    SLOW = "goes on at half its speed"
    STOP = "stops: brakes, goes to rest, torque off, latched"
    STANDS = "stops: brakes, cannot go to rest, stands with torque on, latched"
    TORQUE_OFF = "torque off at once, latched"
    GONE = "the servos stop by themselves"
    GATED = "what is asked is not sent"


class Idle(Enum):
    """The required reaction to a fault before the bus is opened."""

    GOES_ON = "begins"
    REFUSES = "does not begin, torque off"
    ONLY_READS = "does not begin, nothing written"
    ANY = "begins or not, torque off in the end"


@dataclass(frozen=True)
class Row:
    """One fault. inject: injects it into a bench at a time (s after following began; below 0: before the bus opens).

    limit: s from its onset to the reaction; held: to the hold, where the reaction comes after one. cause, then: of the
    stop that is reported, and what ended its braking. sensor: the one that is judged for OUT. said: pattern that a
    message must match. counted: reason under which unused data must be counted. watchdog: s from the onset until every
    servo has stopped by itself; None: not judged. refusal: texts that the refusal of an idle run must have. back: s
    from the onset until data are good again; before back + 0.5 nothing goes on. after: s of following after the onset.
    ends: s from the onset until the run has ended. performer: the performer file. mass: run on the path of a real
    port, with simulated mechanics behind the wire. recorded: the performer is a recording, and the fault is one of its
    sensors. alone: it is not run beside another fault, and nor is a recorded one. approach: it is injected on the
    approach too.

    Beside another fault: chance, by which factor chance may delay the reaction; stretches, by which factor long ticks
    delay the other's; suspends: the host is suspended for the limit; hides: name of a row whose fault it ends.
    """

    name: str
    inject: Callable[[Bench, float], object]
    reaction: Reaction = Reaction.NONE
    limit: float = 0.0
    held: float = HELD_S
    idle: Idle = Idle.GOES_ON
    cause: StopCause | None = None
    then: StopCause | None = None
    sensor: str = ""
    said: str = ""
    counted: str = ""
    watchdog: float | None = None
    refusal: tuple[str, ...] = ()
    back: float | None = None
    after: float = 0.55
    ends: float | None = None
    performer: str = "five"
    mass: bool = False
    recorded: bool = False
    alone: bool = False
    approach: bool = False
    chance: float = 1.0
    stretches: float = 1.0
    suspends: bool = False
    hides: str = ""


Act = Callable[..., object]
"""Injects a fault into a bench, now; what follows the bench are the arguments in the table."""
FLOOD_HZ = 130_000.0
"""Datagrams a second of a flood: about as many as a process can send over loopback."""
_FIRST_NUMBER = re.compile(rb'"p": \[[^,]+,')

# Injections into a sender and its datagrams, besides those of `sender`.


def _no_rotation(datagram: bytes) -> list[bytes]:
    turned = datagram.replace(b"]}", b'], "q": [0.0, 0.0, 0.0, 0.0]}')
    return [turned.replace(b'"axes"', b'"quaternion": "wxyz", "axes"')]


def _garbage_in_place(datagram: bytes) -> list[bytes]:
    return [datagram[: len(datagram) // 2], b"", b"\x00\xff" * 20, datagram, b'{"poses": [[[[']


def _reordered(bench: Bench) -> None:
    kept: list[bytes] = []

    def garble(time: float, datagram: bytes) -> list[bytes]:
        kept.append(datagram)
        del kept[:-3]
        return [kept[-1], kept[-2], kept[-1]] if len(kept) % 3 == 0 else []

    bench.sender.garbles.append(garble)


def _clock_jump(bench: Bench, by: float) -> None:
    before = bench.sender.stamp
    bench.sender.stamp = lambda time: before(time) + by


def _other_sender(bench: Bench, address: str) -> None:
    """Let another sender send whole poses, of which only its address differs."""

    def other(first: float, last: float) -> list[Datagram]:
        poses = {name: np.array([5.0, 5.0, 1.0]) for name in bench.sender.frames.names}
        return [Datagram(bench.clock.now(), (address, 50_000), encoded(bench.sender.stamp(last), poses))]

    bench.sender.others.append(other)


def _flood(bench: Bench) -> None:
    def other(first: float, last: float) -> list[Datagram]:
        times = np.linspace(first, last, round(FLOOD_HZ * (last - first)), endpoint=False)
        return [Datagram(bench.sender.begun + float(time), ("127.0.0.1", 50_001), b"x" * 64) for time in times]

    bench.sender.others.append(other)


# Injections into the host.

OVERRUN = 1.2
"""Periods that a tick takes longer."""
INWARDS = "l_hip_yaw", -1.2, 1.0
"""A joint, the angle (rad) at which the left leg meets the right one, and the speed of the way there (rad/s): slow
enough for a robot that has just gone on."""


def _wall_clock(bench: Bench, by: float) -> None:
    """Set the wall clock."""
    for patched in (
        patch("time.time", lambda: datetime.now(UTC).timestamp() + by),
        patch("time.time_ns", lambda: int(1e9 * (datetime.now(UTC).timestamp() + by))),
    ):
        patched.start()
        bench.undo.append(patched.stop)


def _raising(bench: Bench) -> None:
    def broken(now: float) -> object:
        raise ArithmeticError("forced")

    bench.stream.read = broken  # type: ignore[method-assign, assignment]


def _rest_refused(bench: Bench) -> None:
    """Let the gate refuse every goal on the way to rest, as it does with something in the way."""
    gate, supervisor = bench.machine.gate, bench.machine.supervisor
    check = gate.check

    def refusing(last: CheckedGoal, target: FloatArray | None, **given: Any) -> CheckedGoal | None:
        return None if supervisor.state is RunState.GO_TO_REST else check(last, target, **given)

    gate.check = refusing  # type: ignore[method-assign]


def _signal(bench: Bench) -> None:
    bench.stop_asked = True


def _late(bench: Bench, times: float = np.inf) -> None:
    """Make a tick of a moving robot longer than its period, so many times."""
    seen: list[float] = []

    def dawdle() -> None:
        if len(seen) < times:
            seen.append(bench.clock.now())
            bench.trace.acted += seen if len(seen) == 1 else []
            bench.clock.advance(OVERRUN / bench.robot.profile.safety.rate_hz)

    bench.delays.append(dawdle)


def _following(bench: Bench, change: Callable[[Bench, RobotPosture], RobotPosture], times: float = np.inf) -> None:
    """Change the result of the robot's stage, so many times."""
    follower, seen = bench.machine.follower, list[float]()
    start, step = follower.start, follower.step

    def changed(posture: RobotPosture) -> RobotPosture:
        if len(seen) == times:
            return posture
        seen.append(bench.clock.now())
        bench.trace.acted += seen if len(seen) == 1 else []
        return change(bench, posture)

    follower.start = lambda human: changed(start(human))  # type: ignore[method-assign]
    follower.step = lambda human, dt: changed(step(human, dt))  # type: ignore[method-assign]


def _not_finite(bench: Bench, posture: RobotPosture) -> RobotPosture:
    return replace(posture, q=np.full_like(posture.q, np.nan), joint_positions=posture.joint_positions + np.nan)


def _leg_inwards(bench: Bench, posture: RobotPosture) -> RobotPosture:
    """Act as a stage without observers and stops: turn a leg into the other, within all limits of the joint."""
    joint, angle, speed = INWARDS
    servos, dt = bench.robot.joint_map, 1.0 / bench.robot.profile.safety.rate_hz
    if len(bench.trace.postures) < 2:
        return posture  # nothing has been sent yet
    column = servos.joints.index(joint)
    (_, before), (_, sent) = bench.trace.postures[-2:]
    goal, moved = posture.joint_positions.copy(), sent - before
    change = 0.5 * float(servos.max_acceleration[column]) * dt * dt
    way = np.clip(angle - sent[column], -speed * dt, speed * dt)
    bench.machine.follower.stop = lambda dt: None  # type: ignore[method-assign]
    goal[column] = sent[column] + np.clip(way, moved[column] - change, moved[column] + change)
    q = posture.q.copy()
    q[bench.robot.servo_columns] = goal
    bench.trace.asked.append((bench.clock.now(), goal))
    return replace(posture, q=q, joint_positions=goal)


# Injections into the bus and into servos.


def _line(bench: Bench, kind: str, **rest: Any) -> None:
    """Begin a fault of the emulated line, with its keys."""
    for line in bench.lines.values():
        line.faults.add(Fault(FaultKind(kind), **rest), bench.clock.now())


def _unwritable(bench: Bench) -> None:
    for port in bench.ports.values():
        port.writes_fail = True
    bench.trace.writes_fail = True


def _reset(bench: Bench, device: int, boot_time: float | None = None) -> None:
    servo = bench.servo(device)
    servo.boot_time = servo.boot_time if boot_time is None else boot_time
    servo.reboot(bench.clock.now())


def _slip(bench: Bench, device: int, by: float) -> None:
    """Block a shaft away from its goal, by an angle, rad."""
    servo = bench.servo(device)
    servo.jam(True, bench.clock.now())
    servo.shaft.position += by / servo.servo_model.tick_rad


def _press(bench: Bench, frame: str, force: tuple[float, float, float], seconds: float) -> None:
    """Press against a point of the robot, N."""
    simulation = bench.simulation
    assert simulation is not None, "a robot with mass"
    bench.presses = True
    simulation.push(Push(force, simulation.time, seconds, frame))


def _register(bench: Bench, device: int, name: str, value: int) -> None:
    """Replace a servo by one with another register value."""
    servo = bench.servo(device)
    servo.memory.put(name, value)
    servo.tune()


# Injections by their names in the table.


def _sender(make: Callable[..., sender.SenderFault]) -> Act:
    return lambda bench, *words: bench.sender.faults.append(make(*words))


def _garble(make: Callable[..., list[bytes]]) -> Act:
    return lambda bench, *words: bench.sender.garbles.append(lambda time, datagram: make(datagram, *words))


SENDERS = (sender.silent, sender.flapping, sender.pausing, sender.lost, sender.frozen, sender.swapped)
ACTS: dict[str, Act] = {
    **{make.__name__: _sender(make) for make in SENDERS},
    "moved": _sender(lambda name, by: sender.moved(name, 0.0, sender.EVER, by)),
    # The first number of every position becomes another text.
    "number": _garble(lambda datagram, text: [_FIRST_NUMBER.sub(b'"p": [' + text.encode() + b",", datagram)]),
    "no_rotation": _garble(_no_rotation),
    "garbage_in_place": _garble(_garbage_in_place),
    "reordered": _reordered,
    "clock_jump": _clock_jump,
    "other_sender": _other_sender,
    "flood": _flood,
    "wall_clock": _wall_clock,
    "raising": _raising,
    "signal": _signal,
    "suspended": lambda bench, length: bench.clock.sleep_until(bench.clock.now() + length),
    "kill": Bench.kill,
    "line": _line,
    "unwritable": _unwritable,
    "reset": _reset,
    "overload": lambda bench, device: bench.servo(device).overload(bench.clock.now()),
    "slip": _slip,
    "press": _press,
    "register": _register,
}
ARMED_ACTS: dict[str, Act] = {
    "late": _late,
    "not_finite": lambda bench, times=np.inf: _following(bench, _not_finite, times),
    "leg_inwards": lambda bench: _following(bench, _leg_inwards),
    "rest_refused": _rest_refused,
    "operator_stop": lambda bench: bench.guard.latch(StopCause.REQUESTED, "space bar"),
}
"""Injections into objects that exist once the bus is open: in an idle run they act before arming."""


def _injection(entry: object) -> Callable[[Bench, float], object]:
    """The injection of an entry of the table: a name, a mapping from the name to its arguments, or a list of these."""
    if isinstance(entry, list):
        parts = [_injection(one) for one in entry]
        return lambda bench, at: [part(bench, at) for part in parts]
    ((name, words),) = entry.items() if isinstance(entry, Mapping) else ((str(entry), []),)
    keys = dict(words) if isinstance(words, Mapping) else {}
    places = [] if keys else words if isinstance(words, list) else [words]
    act, earliest = (ARMED_ACTS[name], BEFORE_ARMING) if name in ARMED_ACTS else (ACTS[name], -np.inf)
    return lambda bench, at: bench.at(max(at, earliest), lambda: act(bench, *places, **keys))


TABLE = Path(__file__).with_name("rows.yaml")
ENUMS: dict[str, Any] = {"reaction": Reaction, "idle": Idle, "cause": StopCause, "then": StopCause}


def _row(entry: dict[str, Any]) -> Row:
    values: dict[str, Any] = {key: ENUMS[key][value] if key in ENUMS else value for key, value in entry.items()}
    return Row(**values | {"inject": _injection(entry["inject"]), "refusal": tuple(entry.get("refusal", ()))})


ROWS: tuple[Row, ...] = tuple(_row(entry) for entry in yaml.safe_load(TABLE.read_text(encoding="utf-8")))
APPROACHED: tuple[Row, ...] = tuple(row for row in ROWS if row.approach)
"""Rows that are injected on the approach, too: the posture of a performer is neither solved nor gated there."""
