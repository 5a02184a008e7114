"""A recording as the cycles that it was made of, in their order, for whoever runs it again."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError
from retarget.recording.cycles import Cycles, Done, Shape
from retarget.recording.reading import Recording, TopicRows
from retarget.recording.topics import GOALS, HUMAN_POSTURE, SENSORS, SERVO_FIELDS, SERVOS, TICK, TICK_FIELDS
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray

__all__ = ["Played", "lacking", "played", "postures_sent"]


MOST_CYCLES = 50_000_000
"""Four days at 125 Hz."""


@dataclass(frozen=True, eq=False)
class Played:
    """recording: what was read. cycles: those that are whole, from the first one on. missing: cycles that were never
    written. postures: of a human alone, (T, nq), and the cycles of each (T,)."""

    recording: Recording
    cycles: Cycles
    missing: int
    postures: FloatArray
    posture_cycles: NDArray[np.int64]

    @property
    def whole(self) -> bool:
        """Whether nothing of the run is missing."""
        return not (self.recording.damage or self.missing)

    @property
    def last_tick(self) -> int:
        """The last tick of the performance in it; -1: none."""
        asked = self.cycles.sampled != Done.NOT
        return int(self.cycles.tick[asked].max(initial=-1))


def played(recording: Recording) -> Played:
    """The cycles of a recording. Raises InputError where topics or fields of them are missing."""
    with lacking(recording):
        return _played(recording)


@contextmanager
def lacking(recording: Recording) -> Iterator[None]:
    """Whoever reads fields of its topics: one that is missing, or of another shape, is an InputError."""
    try:
        yield
    except (ValueError, KeyError, IndexError) as error:
        raise InputError(
            "the recording lacks something", where=str(recording.path), found=str(error), next_step="Record it anew"
        ) from None


def postures_sent(found: Played, robot: RobotBody, rows: NDArray[np.intp]) -> FloatArray:
    """Postures (k, nq) that were sent in some rows of the cycles. Raises InputError where the body is another one."""
    cycles, body = found.cycles, robot.body
    rest = np.setdiff1d(np.arange(body.nq), robot.servo_columns)
    if cycles.q.shape[1] != len(robot.servo_columns) or cycles.rest.shape[1] != len(rest):
        raise InputError(
            "joints and body do not belong together",
            where=str(found.recording.path),
            found=f"{cycles.q.shape[1] + cycles.rest.shape[1]} coordinates, {body.source} has {body.nq}",
            next_step="Give the body that was moved: --body FILE.xml",
        )
    q = np.empty((len(rows), body.nq))
    q[:, robot.servo_columns], q[:, rest] = cycles.q[rows], cycles.rest[rows]
    return q


def _played(recording: Recording) -> Played:
    ticks, sensors = recording.topic(TICK), recording.topic(SENSORS)
    has_robot = bool(recording.session.joints)
    servos = recording.topic(SERVOS) if has_robot else None
    rows = _in_order(ticks)
    if rows["cycle"][0] != 0 or rows["tick"].min() < 0 or rows["tick"].max() > rows["cycle"][-1]:
        raise ValueError("its ticks do not begin where a run begins")
    if rows["cycle"][-1] > MOST_CYCLES:
        raise ValueError(f"more than {MOST_CYCLES} cycles")
    count, rest = len(recording.session.joints), _width(rows, "root")
    cycles = Cycles.empty(len(rows), _shape(recording, rows, rest))
    for name, _, own in TICK_FIELDS:
        getattr(cycles, own)[:] = rows[name]
    cycles.clock[:], cycles.weighted[:], cycles.cost[:] = rows["clock"], rows["weighted"], rows["cost"]
    cycles.sensor_valid[:], cycles.sensor_weight[:] = rows["sensor_valid"], rows["sensor_weight"]
    if count:
        cycles.goal[:] = rows["goal"]
    if rest:
        cycles.rest[:] = rows["root"]
    _take_sensors(cycles, sensors, rows["sensor_oriented"])
    asked = cycles.sampled != Done.NOT
    first = np.flatnonzero(asked & (cycles.tick == 0))
    if not asked[0] or cycles.tick[0] != 0 or (cycles.sampled[first] != Done.WELL).any():
        raise ValueError("nobody is there in its first tick")
    if cycles.tick[asked].max() >= recording.session.ticks:
        raise ValueError("it has more ticks than it says")
    if servos is not None:
        _take_servos(cycles, servos)
        if GOALS in recording.topics:
            at, which = _places(cycles, recording.topics[GOALS])
            cycles.q[at] = recording.topics[GOALS].rows["position"][which]
    missing = int(cycles.index[-1]) + 1 - len(cycles)
    human = recording.topics.get(HUMAN_POSTURE)
    if human is None or has_robot:
        return Played(recording, cycles, missing, np.zeros((0, 0)), np.zeros(0, dtype=np.int64))
    return Played(recording, cycles, missing, np.asarray(human.rows["q"], dtype=np.float64), human.cycles)


def _in_order(ticks: TopicRows) -> NDArray[np.void]:
    """The rows of /tick, each cycle once."""
    _, first = np.unique(ticks.rows["cycle"], return_index=True)
    return np.asarray(ticks.rows[first])


def _width(rows: NDArray[np.void], name: str) -> int:
    return int(rows[name].shape[1]) if name in (rows.dtype.names or ()) else 0


def _shape(recording: Recording, rows: NDArray[np.void], rest: int) -> Shape:
    count = len(recording.session.joints)
    return Shape(len(recording.session.sensors), count, rest, 0, 0, 0, 0, 0)


def _places(cycles: Cycles, topic: TopicRows) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Rows of `cycles` of the messages, and which messages have one."""
    at = np.searchsorted(cycles.index, topic.cycles)
    known = at < len(cycles)
    known[known] = cycles.index[at[known]] == topic.cycles[known]
    return at[known], known


def _take_sensors(cycles: Cycles, topic: TopicRows, oriented: NDArray[np.bool_]) -> None:
    at, known = _places(cycles, topic)
    poses = topic.rows["poses"][known]
    cycles.sensor_position[at] = poses[..., :3]
    cycles.sensor_orientation[at] = np.where(oriented[at][..., None], poses[..., [6, 3, 4, 5]], np.nan)
    unsaid = cycles.sampled == Done.WELL
    unsaid[at] = False
    if unsaid.any():
        cycles.sampled[unsaid] = Done.FAILED


def _take_servos(cycles: Cycles, topic: TopicRows) -> None:
    at, known = _places(cycles, topic)
    rows = topic.rows[known]
    cycles.bus_time[at], cycles.read[at] = rows["bus_time"], rows["answer"]
    cycles.retries[at], cycles.rough[at] = rows["retries"], rows["rough"]
    for name, _ in SERVO_FIELDS:
        getattr(cycles, name)[at] = rows[name]
