"""VMC senders that tell bones only: the avatar's bones as poses in the world."""

import numpy as np

from retarget.anthropometry import FRACTIONS
from retarget.frames import BoolArray
from retarget.human_dimensions import HumanDimensions, proportional_dimensions
from retarget.sources.stream_frame import Dropped, StreamFrame
from retarget.sources.vmc import VmcDecoder
from retarget.sources.vmc_bones import (
    LocalBones,
    local_bones,
    merged,
    t_pose_offsets,
    world_positions,
    world_rotations,
)
from retarget.sources.vmc_names import BODY_BONES

__all__ = ["VmcBodyDecoder"]

STATURE_M = 1.70
"""Of a person whose size nobody has told, m: calibration measures the rest."""
PARTS = 8
"""A bone counts for so many datagrams with bones after it was told: some senders split an avatar."""
_NAMES = tuple(f"bone://{bone}" for bone in BODY_BONES)
_FEET = [BODY_BONES.index("LeftFoot"), BODY_BONES.index("RightFoot")]
_HIPS = BODY_BONES.index("Hips")


class VmcBodyDecoder:
    """A `StreamDecoder`: the 22 bones of a humanoid, each `bone://NAME`, position of the joint where it begins.

    Bone lengths that the sender does not tell are those of `person`. Where it does not tell where the hips are, the
    lower foot stands on the ground.
    """

    def __init__(self, person: HumanDimensions | None = None) -> None:
        self._decoder = VmcDecoder()
        self.dropped: Dropped = self._decoder.dropped
        self._offsets = t_pose_offsets(person or proportional_dimensions(STATURE_M))
        self._ankle = FRACTIONS.ankle_height * (STATURE_M if person is None else person.stature)
        self._before: list[LocalBones] = []

    @property
    def work(self) -> float:
        """Microseconds, about, that datagrams have cost beyond their length."""
        return self._decoder.work

    def decode(self, datagram: bytes) -> list[StreamFrame]:
        """The body of one datagram; none when it tells no bone."""
        return [body for frame in self._decoder.decode(datagram) if (body := self._body(frame)) is not None]

    def _body(self, frame: StreamFrame) -> StreamFrame | None:
        told = local_bones(frame)
        if np.isnan(told.rotation).all():
            return None
        self._before = [told, *self._before[: PARTS - 1]]
        bones = told
        for earlier in self._before[1:]:
            if not np.isnan(bones.rotation).any():
                break
            bones = merged(bones, earlier)
        rotations = world_rotations(bones)
        positions = world_positions(bones, rotations, self._offsets)
        if np.isnan(bones.position[_HIPS, 0]):
            lowest = np.nanmin(positions[_FEET, 2]) if np.isfinite(positions[_FEET, 2]).any() else self._ankle
            positions[:, 2] += self._ankle - lowest
        known: BoolArray = np.asarray(np.isfinite(np.hstack((rotations, positions))).all(axis=1))
        return StreamFrame(_NAMES, positions, rotations, known, frame.stamp, frame.number)
