"""What a run tells the process of its page: one datagram per moment that is shown, of numbers in a fixed order."""

import struct
from dataclasses import dataclass

import numpy as np

from retarget.record import ModeArray
from retarget.rotations import FloatArray

__all__ = ["LiveRow", "RowSizes", "pack", "unpack"]

_HEAD = struct.Struct("<d48s256s")
"""Time, state, and why it is so; UTF-8, cut."""


@dataclass(frozen=True)
class RowSizes:
    """How many numbers a row has: of q of robot and human, of servos, landmarks, observers and obstacles, and of the
    truth about a simulated body, and of sensors."""

    robot: int
    human: int
    servos: int
    landmarks: int
    observers: int
    around: int = 0
    truth: int = 0
    sensors: int = 0

    @property
    def lengths(self) -> tuple[int, ...]:
        """Of every part of a row after its head, in their order."""
        servos = (self.servos,) * 3
        points, poses = 3 * self.landmarks, 7 * self.around
        return (self.robot, self.human, *servos, points, self.observers, poses, self.truth, 3 * self.sensors)


@dataclass(frozen=True, eq=False)
class LiveRow:
    """time: s of the run. robot (nq,): posture sent; human (nq,). present (s,) rad, temperature (s,) degrees Celsius
    and current (s,) A of the servos; asked (k, 3) m of the landmarks; modes (o,) of the observers; around (m, 7): poses
    of the obstacles; truth: the numbers of a `Truth`, or none; sensors (s, 3) m."""

    time: float
    state: str
    why: str
    robot: FloatArray
    human: FloatArray
    present: FloatArray
    temperature: FloatArray
    current: FloatArray
    asked: FloatArray
    modes: ModeArray
    around: FloatArray
    truth: FloatArray
    sensors: FloatArray


def pack(row: LiveRow) -> bytes:
    """Bytes of a row, as 32-bit numbers: a tenth of a micrometre of a robot."""
    servos = (row.present, row.temperature, row.current)
    flat = [points.reshape(-1) for points in (row.asked, row.modes, row.around, row.truth, row.sensors)]
    parts = (row.robot, row.human, *servos, *flat)
    head = _HEAD.pack(row.time, row.state.encode(errors="replace")[:48], row.why.encode(errors="replace")[:256])
    return head + np.concatenate(parts).astype(np.float32).tobytes()


def unpack(data: bytes, sizes: RowSizes) -> LiveRow | None:
    """The row of these bytes; None for anything else."""
    if len(data) != _HEAD.size + 4 * sum(sizes.lengths):
        return None
    time, state, why = _HEAD.unpack_from(data)
    numbers = np.frombuffer(data, dtype=np.float32, offset=_HEAD.size).astype(np.float64)
    parts = np.split(numbers, np.cumsum(sizes.lengths)[:-1])
    robot, human, present, temperature, current, asked, modes, around, truth, sensors = parts
    return LiveRow(
        time=time,
        state=_text(state),
        why=_text(why),
        robot=robot,
        human=human,
        present=present,
        temperature=temperature,
        current=current,
        asked=asked.reshape(-1, 3),
        modes=np.nan_to_num(modes).astype(np.uint8),
        around=around.reshape(-1, 7),
        truth=truth,
        sensors=sensors.reshape(-1, 3),
    )


def _text(field: bytes) -> str:
    return field.rstrip(b"\0").decode(errors="ignore")
