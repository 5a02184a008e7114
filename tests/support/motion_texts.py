"""Small motion files for tests, written here by hand: a stick figure as ASF, AMC and BVH, and markers as C3D."""

import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

# Bone, parent, direction (y up, z forward, x left), length in ASF units, dof.
BONES: tuple[tuple[str, str, tuple[float, float, float], float, str], ...] = (
    ("lhipjoint", "root", (0.6, -0.8, 0.0), 2.5, ""),
    ("lfemur", "lhipjoint", (0.0, -1.0, 0.0), 7.5, "rx ry rz"),
    ("ltibia", "lfemur", (0.0, -1.0, 0.0), 7.0, "rx"),
    ("lfoot", "ltibia", (0.0, -0.28, 0.96), 2.2, "rx rz"),
    ("ltoes", "lfoot", (0.0, 0.0, 1.0), 1.0, "rx"),
    ("rhipjoint", "root", (-0.6, -0.8, 0.0), 2.5, ""),
    ("rfemur", "rhipjoint", (0.0, -1.0, 0.0), 7.5, "rx ry rz"),
    ("rtibia", "rfemur", (0.0, -1.0, 0.0), 7.0, "rx"),
    ("rfoot", "rtibia", (0.0, -0.28, 0.96), 2.2, "rx rz"),
    ("rtoes", "rfoot", (0.0, 0.0, 1.0), 1.0, "rx"),
    ("lowerback", "root", (0.0, 1.0, 0.0), 2.0, "rx ry rz"),
    ("upperback", "lowerback", (0.0, 1.0, 0.0), 2.0, "rx ry rz"),
    ("thorax", "upperback", (0.0, 1.0, 0.0), 2.0, "rx ry rz"),
    ("lowerneck", "thorax", (0.0, 1.0, 0.0), 1.6, "rx ry rz"),
    ("upperneck", "lowerneck", (0.0, 1.0, 0.0), 1.6, "rx ry rz"),
    ("head", "upperneck", (0.0, 1.0, 0.0), 1.6, "rx ry rz"),
    ("lclavicle", "thorax", (1.0, 0.0, 0.0), 3.5, "ry rz"),
    ("lhumerus", "lclavicle", (1.0, 0.0, 0.0), 5.0, "rx ry rz"),
    ("lradius", "lhumerus", (1.0, 0.0, 0.0), 3.4, "rx"),
    ("lwrist", "lradius", (1.0, 0.0, 0.0), 1.7, "ry"),
    ("lhand", "lwrist", (1.0, 0.0, 0.0), 0.7, "rx rz"),
    ("lfingers", "lhand", (1.0, 0.0, 0.0), 0.5, "rx"),
    ("rclavicle", "thorax", (-1.0, 0.0, 0.0), 3.5, "ry rz"),
    ("rhumerus", "rclavicle", (-1.0, 0.0, 0.0), 5.0, "rx ry rz"),
    ("rradius", "rhumerus", (-1.0, 0.0, 0.0), 3.4, "rx"),
    ("rwrist", "rradius", (-1.0, 0.0, 0.0), 1.7, "ry"),
    ("rhand", "rwrist", (-1.0, 0.0, 0.0), 0.7, "rx rz"),
    ("rfingers", "rhand", (-1.0, 0.0, 0.0), 0.5, "rx"),
)

AXES = {"lradius": "180 -30 -90", "rradius": "180 30 90", "lfemur": "0 0 20", "rfemur": "0 0 -20"}


def asf_text(*, length: float = 0.45, renamed: Mapping[str, str] | None = None, scale: float = 1.0) -> str:
    """The stick figure as an ASF. renamed: other names for some bones. scale: of the bone lengths."""
    names = dict(renamed or {})
    lines = [
        "# made for a test",
        ":version 1.10",
        ":name stick",
        ":units",
        "  mass 1.0",
        f"  length {length}",
        "  angle deg",
    ]
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
    lines += [
        ":hierarchy",
        "  begin",
        *(f"    {above} {' '.join(below)}" for above, below in children.items()),
        "  end",
    ]
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
JOINTS: tuple[tuple[str, str, tuple[float, float, float]], ...] = (
    ("Hips", "", (0.0, 0.0, 0.0)),
    ("LeftUpLeg", "Hips", (9.0, -9.0, 0.0)),
    ("LeftLeg", "LeftUpLeg", (0.0, -42.0, 0.0)),
    ("LeftFoot", "LeftLeg", (0.0, -41.0, 0.0)),
    ("LeftToeBase", "LeftFoot", (0.0, -6.0, 13.0)),
    ("RightUpLeg", "Hips", (-9.0, -9.0, 0.0)),
    ("RightLeg", "RightUpLeg", (0.0, -42.0, 0.0)),
    ("RightFoot", "RightLeg", (0.0, -41.0, 0.0)),
    ("RightToeBase", "RightFoot", (0.0, -6.0, 13.0)),
    ("Spine", "Hips", (0.0, 11.0, 0.0)),
    ("Spine1", "Spine", (0.0, 12.0, 0.0)),
    ("Neck", "Spine1", (0.0, 12.0, 0.0)),
    ("Head", "Neck", (0.0, 10.0, 0.0)),
    ("LeftShoulder", "Spine1", (2.0, 11.0, 0.0)),
    ("LeftArm", "LeftShoulder", (16.0, 3.0, 0.0)),
    ("LeftForeArm", "LeftArm", (29.0, 0.0, 0.0)),
    ("LeftHand", "LeftForeArm", (26.0, 0.0, 0.0)),
    ("RightShoulder", "Spine1", (-2.0, 11.0, 0.0)),
    ("RightArm", "RightShoulder", (-16.0, 3.0, 0.0)),
    ("RightForeArm", "RightArm", (-29.0, 0.0, 0.0)),
    ("RightHand", "RightForeArm", (-26.0, 0.0, 0.0)),
)
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


MARKERS: dict[str, tuple[float, float, float]] = {
    "LFHD": (80.0, 70.0, 1640.0),
    "RFHD": (80.0, -70.0, 1640.0),
    "LBHD": (-80.0, 70.0, 1640.0),
    "RBHD": (-80.0, -70.0, 1640.0),
    "LWRA": (40.0, 700.0, 1380.0),
    "LWRB": (-40.0, 700.0, 1380.0),
    "RWRA": (40.0, -700.0, 1380.0),
    "RWRB": (-40.0, -700.0, 1380.0),
    "LANK": (0.0, 140.0, 80.0),
    "RANK": (0.0, -140.0, 80.0),
    "LTOE": (150.0, 140.0, 40.0),
    "RTOE": (150.0, -140.0, 40.0),
    "LASI": (90.0, 120.0, 990.0),
    "RASI": (90.0, -120.0, 990.0),
    "LPSI": (-90.0, 50.0, 1010.0),
    "RPSI": (-90.0, -50.0, 1010.0),
}
"""Markers of a T-pose, mm, x forward, y left, z up."""


def c3d_bytes(
    frames: int = 4,
    *,
    prefix: str = "",
    lost: Iterable[tuple[int, str]] = (),
    unit: str = "mm",
    y_up: bool = False,
    rate: float = 100.0,
    names: Mapping[str, str] | None = None,
) -> bytes:
    """The markers as a C3D written by the `c3d` package. lost: (frame, marker) pairs."""
    import c3d

    gone = set(lost)
    writer = c3d.Writer(point_rate=rate, analog_rate=rate, point_scale=-1.0)
    for frame in range(frames):
        points = np.zeros((len(MARKERS), 5), np.float32)
        for i, (name, (x, y, z)) in enumerate(MARKERS.items()):
            points[i, :3] = (y, z, x) if y_up else (x, y, z)
            if (frame, name) in gone:
                points[i] = [0.0, 0.0, 0.0, -1.0, 0.0]
        writer.add_frames([(points, np.zeros((0, 1), np.float32))])
    labels = [prefix + (names or {}).get(name, name) for name in MARKERS]
    writer.set_point_labels(labels)
    group = writer.get("POINT")
    writer.set_screen_axis("+X", "+Y" if y_up else "+Z")
    if unit != "mm":
        group.set_str("UNITS", "length unit", unit, len(unit))
    buffer = io.BytesIO()
    writer.write(buffer)
    return buffer.getvalue()
