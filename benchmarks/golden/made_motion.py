"""A performer made of sines, as files that any version reads: a clip (BVH) and a recorded stream of JSON poses.

The clip stands in where no recorded motion is at hand. The stream wears the five default sensors.
"""

import json
import math
import struct
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path

CLIP_HZ, CLIP_S = 60, 4.0
WALK_S, STEP_S, STRIDE_DEG, KNEE_DEG, SPEED = (0.8, 4.0, 5.0), 0.7, 22.0, 50.0, 0.5
"""The walk: its begin, its end and that of the clip, s; duration of a step, s; how far thighs swing and a knee bends,
and metres a second."""
STREAM_HZ, STILL_S, MOVES_S = 60, 5.0, 12.0
"""The stream stands still while the countdown runs, and moves from then on."""
# Joint, parent, offset in cm (y up, z forward, x left).
JOINTS: tuple[tuple[str, str, tuple[float, float, float]], ...] = (
    ("Hips", "", (0.0, 92.0, 0.0)),
    ("Spine", "Hips", (0.0, 12.0, 0.0)),
    ("Spine1", "Spine", (0.0, 14.0, 0.0)),
    ("Neck", "Spine1", (0.0, 24.0, 0.0)),
    ("Head", "Neck", (0.0, 10.0, 0.0)),
    *(
        (f"{side}{name}", f"{side}{parent}" if parent.startswith(("Up", "Leg", "Foot", "Arm", "Fore")) else parent, at)
        for side, sign in (("Left", 1.0), ("Right", -1.0))
        for name, parent, at in (
            ("UpLeg", "Hips", (sign * 9.0, -4.0, 0.0)),
            ("Leg", "UpLeg", (0.0, -41.0, 0.0)),
            ("Foot", "Leg", (0.0, -40.0, 0.0)),
            ("ToeBase", "Foot", (0.0, -6.0, 14.0)),
            ("Arm", "Spine1", (sign * 18.0, 19.0, 0.0)),
            ("ForeArm", "Arm", (sign * 27.0, 0.0, 0.0)),
            ("Hand", "ForeArm", (sign * 25.0, 0.0, 0.0)),
        )
    ),
)


def write_clip(path: Path) -> Path:
    """Arms swing and bend, the trunk leans and turns, the knees give way a little."""
    return _write(path, CLIP_S, _angles, lambda time: 0.0)


def write_walk(path: Path) -> Path:
    """Someone who stands, walks straight ahead and stands again, arms swinging."""
    begin, end, whole = WALK_S
    return _write(path, whole, _walking, lambda time: 100.0 * SPEED * (min(max(time, begin), end) - begin))


def _write(
    path: Path,
    seconds: float,
    angles_at: Callable[[float], dict[str, Sequence[float]]],
    ahead: Callable[[float], float],
) -> Path:
    """Write a clip of angles, degrees, whose hips are so far ahead, cm, and as high as the longer leg."""
    order: list[str] = []
    lines = ["HIERARCHY", *_joint_lines("Hips", 0, order), "MOTION"]
    frames = round(seconds * CLIP_HZ)
    lines += [f"Frames: {frames}", f"Frame Time: {1.0 / CLIP_HZ:.9f}"]
    for frame in range(frames):
        angles = angles_at(frame / CLIP_HZ)
        reached = []
        for side in ("Left", "Right"):
            thigh = math.radians(angles.get(f"{side}UpLeg", (0.0, 0.0))[1])
            shank = thigh + math.radians(angles.get(f"{side}Leg", (0.0, 0.0))[1])
            reached.append(41.0 * math.cos(thigh) + 40.0 * math.cos(shank))
        values = [0.0, 11.0 + max(reached), ahead(frame / CLIP_HZ)]
        for name in order:
            values += angles.get(name, (0.0, 0.0, 0.0))
        lines.append(" ".join(f"{value:.4f}" for value in values))
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


def _walking(time: float) -> dict[str, Sequence[float]]:
    """Degrees about z, x and y of the joints that turn in the walk."""
    begin, end, _ = WALK_S
    share = min(max(time - begin, 0.0), max(end - time, 0.0), 0.4) / 0.4
    phase = math.pi * (time - begin) / STEP_S
    angles: dict[str, Sequence[float]] = {}
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        swing, bend = math.cos(phase), max(sign * math.sin(phase), 0.0)
        angles[f"{side}UpLeg"] = (0.0, share * (sign * STRIDE_DEG * swing - 0.4 * KNEE_DEG * bend), 0.0)
        angles[f"{side}Leg"] = (0.0, share * KNEE_DEG * bend, 0.0)
        angles[f"{side}Arm"] = (-75.0 * sign, 0.0, 0.0)
        angles[f"{side}ForeArm"] = (0.0, 0.0, -sign * (20.0 + share * 10.0 * sign * swing))
    return angles


def _joint_lines(name: str, depth: int, order: list[str]) -> list[str]:
    """A joint and all below it; `order` gets the names as the motion has them."""
    order.append(name)
    offset = next(at for joint, _, at in JOINTS if joint == name)
    below = [joint for joint, parent, _ in JOINTS if parent == name]
    pad = "  " * depth
    turns = "Zrotation Xrotation Yrotation"
    head = [f"{pad}ROOT {name}", f"{pad}{{", f"{pad}  OFFSET 0 0 0"]
    head += [f"{pad}  CHANNELS 6 Xposition Yposition Zposition {turns}"]
    if depth:
        head = [f"{pad}JOINT {name}", f"{pad}{{", f"{pad}  OFFSET {offset[0]} {offset[1]} {offset[2]}"]
        head += [f"{pad}  CHANNELS 3 {turns}"]
    for joint in below:
        head += _joint_lines(joint, depth + 1, order)
    if not below:
        tip = (
            (0.0, 12.0, 0.0)
            if name == "Head"
            else (0.0, 0.0, 5.0)
            if "Toe" in name
            else (math.copysign(8.0, offset[0]), 0.0, 0.0)
        )
        head += [f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET {tip[0]} {tip[1]} {tip[2]}", f"{pad}  }}"]
    return [*head, f"{pad}}}"]


def _angles(time: float) -> dict[str, Sequence[float]]:
    """Degrees about z, x and y of the joints that turn."""
    slow, fast = (1.0 - math.cos(2.0 * math.pi * time / period) for period in (4.0, 2.0))
    bend = 14.0 * slow
    angles: dict[str, Sequence[float]] = {
        "Spine": (2.0 * fast, 8.0 * slow, 6.0 * fast),
        "Head": (0.0, 0.0, -8.0 * fast),
    }
    for side, sign, swing in (("Left", 1.0, slow), ("Right", -1.0, fast)):
        angles |= {f"{side}UpLeg": (0.0, -bend, 0.0), f"{side}Leg": (0.0, 2.0 * bend, 0.0)}
        angles |= {f"{side}Foot": (0.0, -bend, 0.0)}
        angles |= {f"{side}Arm": (-sign * (75.0 - 25.0 * swing), 0.0, -sign * 20.0 * swing)}
        angles |= {f"{side}ForeArm": (0.0, 0.0, -sign * (10.0 + 25.0 * swing))}
    return angles


RECORD, CHECK = struct.Struct("<QH16sI"), struct.Struct("<I")
SENDER = b"\0" * 10 + b"\xff\xff" + bytes((127, 0, 0, 1))
"""IPv4 address of the sender, as IPv6."""


def write_stream(path: Path) -> Path:
    """As `--record-raw` writes it: CRC-32, arrival in ns, port, address, length, datagram."""
    url = b"json://:14150"
    out = bytearray(b"RAWDGM01" + struct.pack("<H", len(url)) + url)
    for number in range(round((STILL_S + MOVES_S) * STREAM_HZ)):
        data = _datagram(number)
        record = RECORD.pack(10**9 + number * 10**9 // STREAM_HZ, 50000, SENDER, len(data)) + data
        out += CHECK.pack(zlib.crc32(record)) + record
    path.write_bytes(bytes(out))
    return path


def _datagram(number: int) -> bytes:
    """One frame: x forward, y left, z up, metres."""
    time = number / STREAM_HZ
    since = max(time - STILL_S, 0.0)
    slow, fast = (0.5 - 0.5 * math.cos(2.0 * math.pi * since / period) for period in (3.0, 1.5))
    sway = 0.001 * math.sin(2.0 * math.pi * time / 4.0)  # a tracker that stands like a stone is taken for lost
    places = {
        "head": (sway + 0.06 * slow, 0.02 * fast, 1.6 - 0.08 * slow),
        "l_wrist": (sway + 0.30 * slow, 0.25 + 0.10 * fast, 0.8 + 0.35 * slow),
        "r_wrist": (sway + 0.15 * fast, -0.25 - 0.20 * slow, 0.8 + 0.20 * fast),
        "l_ankle": (sway, 0.1, 0.08),
        "r_ankle": (sway, -0.1, 0.08),
    }
    poses = {name: {"p": [round(x, 5) for x in at], "q": [1, 0, 0, 0]} for name, at in places.items()}
    message = {"axes": "rep103", "quaternion": "wxyz", "time": round(time, 5), "frame": number, "poses": poses}
    return json.dumps(message).encode("ascii")
