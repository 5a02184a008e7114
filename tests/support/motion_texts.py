"""Small motion files for tests, written here by hand: a stick figure as ASF, AMC and BVH, and markers as C3D."""

import struct
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

# Bone, parent, direction (y up, z forward, x left), length in ASF units, dof.
Bone = tuple[str, str, tuple[float, float, float], float, str]
LEG: tuple[Bone, ...] = (
    ("lhipjoint", "root", (0.6, -0.8, 0.0), 2.5, ""),
    ("lfemur", "lhipjoint", (0.0, -1.0, 0.0), 7.5, "rx ry rz"),
    ("ltibia", "lfemur", (0.0, -1.0, 0.0), 7.0, "rx"),
    ("lfoot", "ltibia", (0.0, -0.28, 0.96), 2.2, "rx rz"),
    ("ltoes", "lfoot", (0.0, 0.0, 1.0), 1.0, "rx"),
)
ARM: tuple[Bone, ...] = (
    ("lclavicle", "thorax", (1.0, 0.0, 0.0), 3.5, "ry rz"),
    ("lhumerus", "lclavicle", (1.0, 0.0, 0.0), 5.0, "rx ry rz"),
    ("lradius", "lhumerus", (1.0, 0.0, 0.0), 3.4, "rx"),
    ("lwrist", "lradius", (1.0, 0.0, 0.0), 1.7, "ry"),
    ("lhand", "lwrist", (1.0, 0.0, 0.0), 0.7, "rx rz"),
    ("lfingers", "lhand", (1.0, 0.0, 0.0), 0.5, "rx"),
)
TRUNK = ("root", "lowerback", "upperback", "thorax", "lowerneck", "upperneck", "head")
SPINE = tuple(
    (bone, below, (0.0, 1.0, 0.0), 1.6 if "neck" in bone + below else 2.0, "rx ry rz")
    for below, bone in pairwise(TRUNK)
)


def _right(left: Sequence[Bone]) -> tuple[Bone, ...]:
    return tuple(
        (f"r{bone[1:]}", parent if parent in TRUNK else f"r{parent[1:]}", (0.0 - x, y, z), length, dof)
        for bone, parent, (x, y, z), length, dof in left
    )


BONES: tuple[Bone, ...] = (*LEG, *_right(LEG), *SPINE, *ARM, *_right(ARM))
AXES = {"lradius": "180 -30 -90", "rradius": "180 30 90", "lfemur": "0 0 20", "rfemur": "0 0 -20"}


def asf_text(*, length: float = 0.45, renamed: Mapping[str, str] | None = None, scale: float = 1.0) -> str:
    """The stick figure as an ASF. renamed: other names for some bones. scale: of the bone lengths."""
    names = dict(renamed or {})
    lines = ["# made for a test", ":version 1.10", ":name stick"]
    lines += [":units", "  mass 1.0", f"  length {length}", "  angle deg"]
    lines += [":documentation", "  none", ":root", "  order TX TY TZ RX RY RZ", "  axis XYZ"]
    lines += ["  position 0 0 0", "  orientation 0 0 0", ":bonedata"]
    children: dict[str, list[str]] = {}
    for i, (bone, parent, direction, size, dof) in enumerate(BONES, start=1):
        name, above = names.get(bone, bone), names.get(parent, parent)
        children.setdefault(above, []).append(name)
        lines += ["  begin", f"    id {i}", f"    name {name}", "    direction {} {} {}".format(*direction)]
        lines += [f"    length {size * scale}", f"    axis {AXES.get(bone, '0 0 0')} XYZ"]
        if dof:
            lines.append(f"    dof {dof}")
            lines += [("    limits " if k == 0 else "           ") + "(-inf inf)" for k in range(len(dof.split()))]
        lines.append("  end")
    tree = [f"    {above} {' '.join(below)}" for above, below in children.items()]
    lines += [":hierarchy", "  begin", *tree, "  end"]
    return "\n".join(lines) + "\n"


def amc_text(frames: int = 3, *, angles: Mapping[str, Sequence[float]] | None = None, height: float = 17.0) -> str:
    """A motion of the stick figure: it walks along z; `angles` (degrees) of some bones, all others zero."""
    lines = ["#!OML:ASF stick.asf", ":FULLY-SPECIFIED", ":DEGREES"]
    for frame in range(1, frames + 1):
        lines += [str(frame), f"root 0 {height} {0.1 * (frame - 1)} 0 0 0"]
        for bone, _, _, _, dof in BONES:
            if dof:
                values = (angles or {}).get(bone, [0.0] * len(dof.split()))
                lines.append(" ".join([bone, *(f"{value:g}" for value in values)]))
    return "\n".join(lines) + "\n"


def write_amc(folder: Path, text: str, *, skeleton: str | None = None, name: str = "07_01.amc") -> Path:
    """An AMC with its ASF beside it; returns the AMC."""
    (folder / f"{name.split('_', maxsplit=1)[0]}.asf").write_text(asf_text() if skeleton is None else skeleton)
    path = folder / name
    path.write_text(text)
    return path


# Joint, parent, offset in cm (y up, z forward, x left).
Joint = tuple[str, str, tuple[float, float, float]]
LEFT_LEG: tuple[Joint, ...] = (
    ("LeftUpLeg", "Hips", (9.0, -9.0, 0.0)),
    ("LeftLeg", "LeftUpLeg", (0.0, -42.0, 0.0)),
    ("LeftFoot", "LeftLeg", (0.0, -41.0, 0.0)),
    ("LeftToeBase", "LeftFoot", (0.0, -6.0, 13.0)),
)
LEFT_ARM: tuple[Joint, ...] = (
    ("LeftShoulder", "Spine1", (2.0, 11.0, 0.0)),
    ("LeftArm", "LeftShoulder", (16.0, 3.0, 0.0)),
    ("LeftForeArm", "LeftArm", (29.0, 0.0, 0.0)),
    ("LeftHand", "LeftForeArm", (26.0, 0.0, 0.0)),
)
BACK: tuple[Joint, ...] = (
    ("Spine", "Hips", (0.0, 11.0, 0.0)),
    ("Spine1", "Spine", (0.0, 12.0, 0.0)),
    ("Neck", "Spine1", (0.0, 12.0, 0.0)),
    ("Head", "Neck", (0.0, 10.0, 0.0)),
)


def _to_right(left: Sequence[Joint]) -> tuple[Joint, ...]:
    return tuple((a.replace("Left", "Right"), b.replace("Left", "Right"), (0.0 - x, y, z)) for a, b, (x, y, z) in left)


JOINTS = (("Hips", "", (0.0, 0.0, 0.0)), *LEFT_LEG, *_to_right(LEFT_LEG), *BACK, *LEFT_ARM, *_to_right(LEFT_ARM))
END_SITES = {"LeftToeBase": (0.0, 0.0, 6.0), "RightToeBase": (0.0, 0.0, 6.0), "Head": (0.0, 18.0, 0.0)}
HAND_END = {"LeftHand": (16.0, 0.0, 0.0), "RightHand": (-16.0, 0.0, 0.0)}


def bvh_text(
    frames: int = 3,
    *,
    scale: float = 1.0,
    names: Mapping[str, str] | None = None,
    order: str = "ZXY",
    rotations: Mapping[str, Sequence[float]] | None = None,
    root: Sequence[float] = (0.0, 98.0, 0.0),
    frame_time: str = "0.008333",
    z_up: bool = False,
) -> str:
    """The stick figure as a BVH. rotations: degrees in the channel order, of some joints; names: new names for some."""
    renamed = dict(names or {})
    lines = ["HIERARCHY"]
    values = [f"{value * scale:g}" for value in root]

    def vector(offset: Sequence[float]) -> str:
        x, y, z = (component * scale for component in offset)
        return f"{-z:g} {-x:g} {y:g}".replace("-0 ", "0 ") if z_up else f"{x:g} {y:g} {z:g}"

    def block(joint: str, offset: Sequence[float], depth: int) -> None:
        pad = "  " * depth
        lines.extend([f"{pad}{'JOINT' if depth else 'ROOT'} {renamed.get(joint, joint)}", f"{pad}{{"])
        lines.append(f"{pad}  OFFSET {vector(offset)}")
        channels = " ".join(f"{axis}rotation" for axis in order)
        lines.append(
            f"{pad}  CHANNELS " + (f"3 {channels}" if depth else f"6 Xposition Yposition Zposition {channels}")
        )
        values.extend(f"{angle:g}" for angle in (rotations or {}).get(joint, (0.0, 0.0, 0.0)))
        for name, parent, below in JOINTS:
            if parent == joint:
                block(name, below, depth + 1)
        end = {**END_SITES, **HAND_END}.get(joint)
        if end is not None:
            lines.extend([f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET {vector(end)}", f"{pad}  }}"])
        lines.append(f"{pad}}}")

    block("Hips", (0.0, 0.0, 0.0), 0)
    lines += ["MOTION", f"Frames: {frames}", f"Frame Time: {frame_time}", *[" ".join(values)] * frames]
    return "\n".join(lines) + "\n"


LEFT_MARKERS = {"FHD": (80.0, 70.0, 1640.0), "BHD": (-80.0, 70.0, 1640.0), "WRA": (40.0, 700.0, 1380.0)}
LEFT_MARKERS |= {"WRB": (-40.0, 700.0, 1380.0), "ANK": (0.0, 140.0, 80.0), "TOE": (150.0, 140.0, 40.0)}
LEFT_MARKERS |= {"ASI": (90.0, 120.0, 990.0), "PSI": (-90.0, 50.0, 1010.0)}
MARKERS = {
    f"{s}{name}": (x, sign * y, z) for name, (x, y, z) in LEFT_MARKERS.items() for s, sign in (("L", 1), ("R", -1))
}
"""Markers of a T-pose, mm, x forward, y left, z up."""


C3D_PROCESSORS = {"intel": 84, "dec": 85, "mips": 86}
"""Byte of a C3D file that says its byte order and floats."""


def c3d_floats(values: object, processor: str) -> bytes:
    """Floats in the format of a processor."""
    array = np.asarray(values, np.float32).ravel()
    if processor != "dec":
        return array.astype(">f4" if processor == "mips" else "<f4").tobytes()
    words = (array * np.float32(4.0)).view(np.uint32)
    return np.stack([words >> 16, words & 0xFFFF], axis=1).astype("<u2").tobytes()


def c3d_parameter(group: int, name: str, value: object, processor: str) -> bytes:
    """One parameter of a C3D. Lists of texts have two dimensions; integers and floats as many as the array."""
    order = ">" if processor == "mips" else "<"
    if isinstance(value, str | list):
        rows = [value] if isinstance(value, str) else value
        width = max(map(len, rows))
        shape = [width] if isinstance(value, str) else [width, len(rows)]
        kind, data = -1, b"".join(row.ljust(width).encode() for row in rows)
    else:
        array = np.asarray(value)
        shape = list(array.shape)
        kind = 4 if array.dtype.kind == "f" else 2
        data = c3d_floats(array, processor) if kind == 4 else array.ravel().astype(f"{order}u2").tobytes()
    body = struct.pack("bB", kind, len(shape)) + bytes(shape) + data + b"\0"
    return struct.pack("bb", len(name), group) + name.encode() + struct.pack(f"{order}H", len(body) + 2) + body


def c3d_bytes(
    frames: int = 4,
    *,
    prefix: str = "",
    lost: Iterable[tuple[int, str]] = (),
    unit: str = "mm",
    y_up: bool = False,
    rate: float = 100.0,
    names: Mapping[str, str] | None = None,
    markers: Mapping[str, tuple[float, float, float]] = MARKERS,
    at: Mapping[tuple[int, str], tuple[float, float, float]] | None = None,
    processor: str = "intel",
    steps: float = 0.0,
    first: int = 1,
    analog: int = 0,
    more: Mapping[str, object] | None = None,
) -> bytes:
    """The markers as a C3D. lost: (frame, marker) pairs; at: where a marker is instead. steps: points as whole numbers
    of this size, 0: as floats. first: number of the first frame. analog: values per frame. more: further parameters,
    and what replaces the usual ones, None: left out."""
    order = ">" if processor == "mips" else "<"
    gone, moved = set(lost), at or {}

    scale = steps or -1.0
    labels = [prefix + (names or {}).get(name, name) for name in markers]
    values: dict[str, object] = {
        "POINT:USED": len(markers), "POINT:SCALE": float(scale), "POINT:RATE": float(rate), "POINT:FRAMES": frames,
        "POINT:LABELS": labels, "POINT:UNITS": unit, "POINT:X_SCREEN": "+X", "POINT:Y_SCREEN": "+Y" if y_up else "+Z",
    }  # fmt: skip
    values = {key: value for key, value in {**values, **(more or {})}.items() if value is not None}
    groups = [*dict.fromkeys(key.split(":")[0] for key in values)]
    section = bytes((1, 0x50, 0, C3D_PROCESSORS[processor]))
    for key, value in values.items():
        section += c3d_parameter(1 + groups.index(key.split(":")[0]), key.split(":")[1], value, processor)
    for number, name in enumerate(groups, start=1):  # groups may stand behind their parameters
        section += struct.pack("bb", len(name), -number) + name.encode() + struct.pack(f"{order}HB", 3, 0)
    blocks = -(-(len(section) + 2) // 512)
    header = bytes((2, 0x50)) + struct.pack(f"{order}4H", len(markers), analog, first, first + frames - 1) + bytes(2)
    header += c3d_floats([scale], processor) + struct.pack(f"{order}HH", 2 + blocks, 1 if analog else 0)
    header += c3d_floats([rate], processor)
    data = b""
    for frame in range(frames):
        points = np.zeros((len(markers), 4))
        for row, (name, place) in enumerate(markers.items()):
            x, y, z = moved.get((frame, name), place)
            points[row] = (y, z, x, 0.0) if y_up else (x, y, z, 0.0)
            points[row, 3] = -1.0 if (frame, name) in gone else 0.0  # the residual alone says so
        whole = np.round(points / np.array([steps or 1.0] * 3 + [1.0]))
        data += whole.astype(f"{order}i2").tobytes() if steps else c3d_floats(points, processor)
        data += bytes((2 if steps else 4) * analog)
    return header.ljust(512, b"\0") + section.ljust(512 * blocks, b"\0") + data.ljust(-(-len(data) // 512) * 512, b"\0")
