"""Judges the bytes that a host sent: goals inside limits, slow enough, at rest in time, clear of collision.

It shares no code with what it judges.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from hardware.servo import ServoSpec
from retarget.model.body_file import compile_body
from retarget.model.robot import RobotBody
from retarget.report.clearance import Clearance, PlacedBody
from retarget.types import FloatArray
from sim.faults.bounds import BOUNDS

# The frames of protocol 2.0 that a host sent, and what they write.

HEADER = b"\xff\xff\xfd\x00"
READS = frozenset((0x01, 0x02, 0x82, 0x8A, 0x92, 0x9A))
"""Ping, read, (fast) sync read, (fast) bulk read: they change no device."""
WRITE, REG_WRITE, SYNC_WRITE = 0x03, 0x04, 0x83
GOAL_POSITION, TORQUE_ENABLE, WATCHDOG = 116, 64, 98
"""Instructions of protocol 2.0 and registers of the X series (e-Manual), not shared with the driver."""


@dataclass(frozen=True)
class Sent:
    """Bytes that the host passed to its port. time: s."""

    time: float
    data: bytes


@dataclass(frozen=True, slots=True)
class Packet:
    """An instruction. time: s; id: of the device; params: unstuffed."""

    time: float
    id: int
    instruction: int
    params: bytes


@dataclass(frozen=True, slots=True)
class Written:
    """A write: signed values by id, at an address. time: s."""

    time: float
    address: int
    values: dict[int, int]

    def torque(self, *, on: bool) -> bool:
        """Return whether it switches torque: on for any servo, or off for all."""
        return self.address == TORQUE_ENABLE and any(self.values.values()) is on


def packets(sent: Sequence[Sent]) -> Iterator[Packet]:
    """Yield every instruction, in order."""
    for one in sent:
        data = one.data
        at = data.find(HEADER)
        while at >= 0:
            length = int.from_bytes(data[at + 5 : at + 7], "little")
            body = data[at + 7 : at + 7 + length - 2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            if body:
                yield Packet(one.time, data[at + 4], body[0], body[1:])
            at = data.find(HEADER, at + 7)


def written(sent: Sequence[Sent]) -> list[Written]:
    """Return every write to a single servo or to several."""
    found = []
    for packet in packets(sent):
        params = packet.params
        if packet.instruction == SYNC_WRITE and len(params) > 4:
            address, size = (int.from_bytes(params[k : k + 2], "little") for k in (0, 2))
            items = range(4, len(params) - size, size + 1)
            values = {params[k]: int.from_bytes(params[k + 1 : k + 1 + size], "little", signed=True) for k in items}
            found.append(Written(packet.time, address, values))
        elif packet.instruction in (WRITE, REG_WRITE) and len(params) > 2:
            value = int.from_bytes(params[2:], "little", signed=True)
            found.append(Written(packet.time, int.from_bytes(params[:2], "little"), {packet.id: value}))
    return found


def goal_writes(writes: Sequence[Written]) -> list[tuple[float, dict[int, int]]]:
    """Return times (s) and goals (ticks by id) of every write of goal positions."""
    return [(one.time, one.values) for one in writes if one.address == GOAL_POSITION]


def torque_off(writes: Sequence[Written], since: float) -> float | None:
    """Return when torque off was first commanded from a time on, s."""
    return next((one.time for one in writes if one.time >= since and one.torque(on=False)), None)


SPANS = (1, 2, 4, 8, 16)
"""Spans, in goals, of speed and its change: over long ones, rounding hides little."""
Goals = Sequence[tuple[float, dict[int, int]]]
"""Times (s) and goals (ticks by id)."""


@dataclass(frozen=True, eq=False)
class Track:
    """The goals of one servo: times (T,) s, angle (T,) rad of the joint; step: rad of the joint per tick."""

    servo: ServoSpec
    times: FloatArray
    angle: FloatArray
    step: float

    def between(self, first: float, last: float) -> FloatArray:
        """The angles from `first` to before `last`, s."""
        return np.asarray(self.angle[(self.times >= first) & (self.times < last)])


def once(goals: Goals, *, within: float) -> Goals:
    """Leave out goals that are repeated within `within` s, as on a noisy line."""
    found: list[tuple[float, dict[int, int]]] = []
    for time, goal in goals:
        if not (found and goal == found[-1][1] and time - found[-1][0] < within):
            found.append((time, goal))
    return found


def tracks(goals: Goals, servos: Sequence[ServoSpec]) -> list[Track]:
    """The goals of each of the plain servos (no couplings) that got any."""
    found = []
    for servo in servos:
        own = [(time, goal[servo.id]) for time, goal in goals if servo.id in goal]
        if own:
            times, ticks = np.array(own, dtype=np.float64).T
            angle = (ticks - servo.zero_tick) / servo.ticks_per_rad
            found.append(Track(servo, times, angle, servo.model.tick_rad / servo.gear))
    return found


def posture_tracks(postures: Sequence[tuple[float, FloatArray]], servos: Sequence[ServoSpec]) -> list[Track]:
    """Return postures, times (s) and (n,) rad in the order of the servos, as tracks."""
    times = np.array([time for time, _ in postures])
    angles = np.array([posture for _, posture in postures]).reshape(len(postures), len(servos))
    return [
        Track(servo, times, angles[:, column], servo.model.tick_rad / servo.gear) for column, servo in enumerate(servos)
    ]


def beyond_limits(goal_tracks: Sequence[Track], dt: float) -> list[str]:
    """The violations of limits by goals every `dt` s, a line each. A late goal must not catch up."""
    found = []
    for track in goal_tracks:
        servo, angle = track.servo, track.angle
        if not np.isfinite(angle).all():
            found.append(f"{servo.label}: not finite")
            continue
        beyond = max(float((servo.lower - angle).max()), float((angle - servo.upper).max()))
        if beyond > track.step:
            found.append(f"{servo.label}: {beyond:.3f} rad beyond its limits")
        for run in np.split(angle, np.flatnonzero(np.diff(track.times) >= BOUNDS.off_between_s) + 1):
            rounding = _rounding(track, run)
            fast = _beyond(run, servo.max_velocity * dt, rounding)
            if fast > 0.0:
                found.append(f"{servo.label}: {fast / dt:.2f} rad/s too fast")
            hard = _beyond(np.diff(run), servo.max_acceleration * dt**2, rounding[1:] + rounding[:-1])
            if hard > 0.0:
                found.append(f"{servo.label}: {hard / dt**2:.0f} rad/s^2 too hard")
    return found


def _rounding(track: Track, angle: FloatArray) -> FloatArray:
    """Return how far goals may be from the unrounded ones, rad."""
    room = np.minimum(angle - track.servo.lower, track.servo.upper - angle)
    ticks = np.where(room < track.step, BOUNDS.rounded_inwards_ticks, BOUNDS.rounded_ticks)
    return np.asarray(ticks * track.step)


def _beyond(values: FloatArray, most: float, rounding: FloatArray) -> float:
    """Return by how much values change more than `most` in a tick; 0 where they do not. rounding: of each value."""
    found = 0.0
    for n in SPANS[: int(np.searchsorted(SPANS, len(values)))]:
        change = np.abs(values[n:] - values[:-n]) - rounding[n:] - rounding[:-n] - BOUNDS.numerics_rad
        found = max(found, float(change.max()) / n - most)
    return found


def still_moving(goal_tracks: Sequence[Track], first: float, last: float, *, ticks: int = 0) -> list[str]:
    """The servos that still move by more than some ticks between two times, s, a line each."""
    found = []
    for track in goal_tracks:
        angles = track.between(first, last)
        if angles.size and np.ptp(angles) > ticks * track.step * 1.001:
            found.append(f"{track.servo.label} still moves, by {np.ptp(angles):.4f} rad")
    return found


def stood(goal_tracks: Sequence[Track], time: float) -> bool:
    """Return whether the last two goals of every servo before a time, s, were the same."""
    return all(len(set(track.angle[track.times <= time][-2:].tolist())) <= 1 for track in goal_tracks)


def too_fast(goal_tracks: Sequence[Track], first: float, last: float, *, share: float, dt: float) -> list[str]:
    """The servos that go faster than a share of their greatest speed between two times, s, a line each."""
    found = []
    for track in goal_tracks:
        angles = track.between(first, last)
        fast = _beyond(angles, share * track.servo.max_velocity * dt, _rounding(track, angles))
        if fast > 0.0:
            found.append(f"{track.servo.label}: {fast / dt:.2f} rad/s faster than {share:.0%} of its speed")
    return found


def detours(goal_tracks: Sequence[Track], first: float, last: float) -> list[str]:
    """The servos that make a detour between two times, s, a line each."""
    found = []
    for track in goal_tracks:
        angles = track.between(first, last)
        if angles.size:
            more = float(np.abs(np.diff(angles)).sum() - abs(angles[-1] - angles[0]))
            if more > BOUNDS.straight_ticks * track.step:
                found.append(f"{track.servo.label} goes back and forth, by {more:.3f} rad")
    return found


def after_latch(writes: Sequence[Written], latched: float) -> list[str]:
    """Return writes after a latch, s, other than torque off and watchdog off: once of each kind."""
    wrong = {
        f"address {one.address} was written {one.time - latched:.3f} s after the latch"
        for one in writes
        if one.time > latched and not (one.address in (TORQUE_ENABLE, WATCHDOG) and not any(one.values.values()))
    }
    return sorted(wrong)[:3]


def torque_on_again(writes: Sequence[Written], since: float) -> list[str]:
    """Return whether torque was switched on from a time on, s."""
    again = [one for one in writes if one.time > since and one.torque(on=True)]
    return [f"torque was switched on {one.time - since:.3f} s after the stop began" for one in again[:1]]


def not_reads(packets: Sequence[Packet], *, but: frozenset[int]) -> list[str]:
    """Return instructions other than reads. but: ids of devices that are no servos."""
    return [
        f"instruction 0x{one.instruction:02x} went to id {one.id}"
        for one in packets
        if one.instruction not in READS and one.id not in but
    ][:3]


# Self-collision of the goals that were sent: by the body file in MuJoCo, without any code of the gate.

_compiled = cache(compile_body)


def clearance_of(robot: RobotBody, postures: FloatArray) -> Clearance:
    """The clearance, m, of the body to itself in postures (T, nq), rad."""
    file = _compiled(robot.profile.body_path, root=robot.profile.root)
    placed = PlacedBody(file, postures, np.arange(len(postures)))
    neutral = robot.posture(robot.profile.postures.neutral)
    return placed.to_itself(neutral=neutral, ignored=[entry.pair for entry in robot.profile.ignore_pairs])


def collisions(robot: RobotBody, goal_tracks: Sequence[Track]) -> list[str]:
    """The deepest collision of goals, in words, if there is one. The root stays as in the body file."""
    times = goal_tracks[0].times if goal_tracks else np.zeros(0)
    postures = np.tile(robot.body.qpos0, (len(times), 1))  # (T, nq) [rad] at the times of the first servo
    columns = dict(zip(robot.joint_map.joints, robot.servo_columns, strict=True))
    for track in goal_tracks:
        rows = np.clip(np.searchsorted(track.times, times, side="right") - 1, 0, None)
        postures[:, columns[track.servo.joint]] = track.angle[rows]
    found = clearance_of(robot, postures)
    if found.smallest is None or found.smallest > -BOUNDS.deepest_m or found.pair is None:
        return []
    return [f"{' and '.join(found.pair)} are {-1e3 * found.smallest:.1f} mm in each other"]
