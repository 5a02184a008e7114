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
    """How many numbers a row has: of q of robot and human, of servos, landmarks and observers."""

    robot: int
    human: int
    servos: int
    landmarks: int
    observers: int

    @property
    def lengths(self) -> tuple[int, ...]:
        """Of every part of a row after its head, in their order."""
        return (self.robot, self.human, self.servos, self.servos, 3 * self.landmarks, self.observers)


@dataclass(frozen=True, eq=False)
class LiveRow:
    """time: s of the run. robot (nq,): posture sent; human (nq,). present (s,) rad and temperature (s,) degrees Celsius
    of the servos; asked (k, 3) m of the landmarks; modes (o,) of the observers."""

    time: float
    state: str
    why: str
    robot: FloatArray
    human: FloatArray
    present: FloatArray
    temperature: FloatArray
    asked: FloatArray
    modes: ModeArray


def pack(row: LiveRow) -> bytes:
    """Bytes of a row, as 32-bit numbers: a tenth of a micrometre of a robot."""
    parts = (row.robot, row.human, row.present, row.temperature, row.asked.reshape(-1), row.modes)
    head = _HEAD.pack(row.time, row.state.encode(errors="replace")[:48], row.why.encode(errors="replace")[:256])
    return head + np.concatenate(parts).astype(np.float32).tobytes()


def unpack(data: bytes, sizes: RowSizes) -> LiveRow | None:
    """The row of these bytes; None for anything else."""
    if len(data) != _HEAD.size + 4 * sum(sizes.lengths):
        return None
    time, state, why = _HEAD.unpack_from(data)
    numbers = np.frombuffer(data, dtype=np.float32, offset=_HEAD.size).astype(np.float64)
    robot, human, present, temperature, asked, modes = np.split(numbers, np.cumsum(sizes.lengths)[:-1])
    return LiveRow(
        time, _text(state), _text(why), robot, human, present, temperature, asked.reshape(-1, 3), modes.astype(np.uint8)
    )


def _text(field: bytes) -> str:
    return field.rstrip(b"\0").decode(errors="ignore")
