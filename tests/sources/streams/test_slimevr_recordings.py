"""SlimeVR's real bytes against the motion that was scripted for it.

Alignment: the script's angles at the wall time of each datagram, no lag fitted, no frame left out. Frames in which an
angle moves are judged apart, because most of the recording stands still. Errors are angles of whole rotations, so that
a wrong axis or side is an error of the full motion.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from live_rig import ROLE_SETS, canonical_orientation
from retarget.model.human_dimensions import proportional_dimensions
from retarget.rotations import angle_between, conjugate, from_axis_angle, multiply
from retarget.sources.streams.raw_record import RawReader
from retarget.sources.streams.stream_frame import StreamDecoder, StreamFrame
from retarget.sources.streams.vmc import VmcDecoder, bone_poses, t_pose_offsets, world_poses
from retarget.sources.streams.vrchat import VrchatDecoder
from retarget.types import FloatArray

MOVING_DEG_PER_S = 5.0


@dataclass(frozen=True, eq=False)
class Recording:
    """Decoded frames with their wall times, and the script."""

    wall: FloatArray
    frames: list[StreamFrame]
    script: dict[str, FloatArray]

    def orientations(self, name: str) -> FloatArray:
        return np.array([frame.orientation[frame.names.index(name)] for frame in self.frames])

    def angle(self, column: str) -> FloatArray:
        """Scripted degrees at each frame."""
        return np.interp(self.wall, self.script["wall_s"], self.script[column])


def record(shared: Path, name: str, decoder: StreamDecoder) -> Recording:
    folder = shared / "streams/slimevr"
    rows = [(r.time_s, f) for r in RawReader(folder / name) for f in decoder.decode(r.payload)]
    table = np.genfromtxt(folder / "ground_truth.csv", delimiter=",", names=True)
    script = {name: table[name] for name in table.dtype.names or ()}
    return Recording(np.array([wall for wall, _ in rows]), [frame for _, frame in rows], script)


def segments(recording: Recording, roles: str) -> dict[str, FloatArray]:
    """World orientations (T, 4), identity where arms hang, by canonical sensor."""
    return {
        one.segment: canonical_orientation(one, recording.orientations(one.name))
        for one in ROLE_SETS[roles]
        if one.segment
    }


def bone_segments(recording: Recording) -> dict[str, FloatArray]:
    """The same from the bones alone, by forward kinematics."""
    lengths = t_pose_offsets(proportional_dimensions(1.7))
    world = [world_poses(bone_poses(frame), lengths) for frame in recording.frames]
    return {
        one.segment: canonical_orientation(one, np.array([poses[one.name][1] for poses in world]))
        for one in ROLE_SETS["unity_bones"]
        if one.segment
    }


def errors(recording: Recording, parts: dict[str, FloatArray], wrist: str) -> dict[str, FloatArray]:
    """Degrees (T,) between the turn of a joint as sent and as scripted."""
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    joints = {
        "left_arm_abd_deg": ("chest", "l_shoulder", (1.0, 0.0, 0.0)),
        "right_elbow_flex_deg": ("r_shoulder", wrist, (0.0, -1.0, 0.0)),
        "left_hip_flex_deg": ("pelvis", "l_hip", (0.0, -1.0, 0.0)),
        "yaw_deg": ("", "pelvis", (0.0, 0.0, 1.0)),
    }
    out = {}
    for column, (parent, child, axis) in joints.items():
        if child not in parts or (parent and parent not in parts):
            continue
        above = parts[parent] if parent else upright
        scripted = from_axis_angle(np.array(axis), np.radians(recording.angle(column)))
        out[column] = np.degrees(angle_between(multiply(conjugate(above), parts[child]), scripted))
    return out


VMC, VRCHAT = "full12_vmc_50hz.udprec.gz", "full12_vrcosc_20hz.udprec.gz"


@pytest.mark.parametrize(
    ("name", "parts", "wrist", "median"),
    [
        (VMC, lambda recording: segments(recording, "slimevr"), "r_wrist", 1.0),
        (VMC, bone_segments, "r_elbow", 1.0),
        (VRCHAT, lambda recording: segments(recording, "slimevr_vrchat"), "", 0.5),
    ],
    ids=["roles", "bones", "trackers"],
)
def test_joints_follow_the_script(
    shared: Path, name: str, parts: Callable[[Recording], dict[str, FloatArray]], wrist: str, median: float
) -> None:
    recording = record(shared, name, VmcDecoder() if name == VMC else VrchatDecoder())
    found = errors(recording, parts(recording), wrist)
    assert set(found) == {"left_arm_abd_deg", "left_hip_flex_deg", "yaw_deg"} | (
        {"right_elbow_flex_deg"} if wrist else set()
    )
    for column, error in found.items():
        angle = recording.angle(column)
        moves = np.abs(np.gradient(angle, recording.wall)) > MOVING_DEG_PER_S
        assert np.count_nonzero(moves) > 20 and np.ptp(angle) > 40.0
        assert np.median(error) < median and np.median(error[moves]) < median, column
        assert error.max() < 2.0, column


@pytest.mark.parametrize(
    "name", ["pythonosc_vmc_bundle", "vmcp_1.0.6_bundle", "pythonosc_vmc_single_tra", "vmcp_1.0.6_single_bone"]
)
def test_other_senders_of_vmc(shared: Path, name: str) -> None:
    decoder = VmcDecoder()
    (frame,) = decoder.decode((shared / f"streams/osc/{name}.bin").read_bytes())
    assert decoder.dropped.count == 0 and frame.tracked.all()
    if "bone://Hips" in frame.names:
        hips = frame.names.index("bone://Hips")
        assert_allclose(frame.position[hips], [-0.2, -0.1, 0.95], atol=1e-6)
        assert_allclose(frame.orientation[hips], [0.9239, 0.0, 0.0, -0.3827], atol=1e-4)
    if "bundle" in name:
        assert frame.stamp == 1.25 and decoder.loaded
