"""`make fuzz N=1000000`: damaged files of every kind that we read are read, or refused by a message.

Each case follows from the seed and its number: a file of the corpus, made anew by the project itself, that is cut, bent
or given hostile values, also inside of what is packed, with the sums that belong to it. A case fails that raises
anything but a `RetargetError`, or that takes more than 5 s of CPU time or 1.5 GB, with the child in which a body is
compiled. Its file is kept in out/fuzz.
"""

import argparse
import json
import os
import re
import resource
import shutil
import signal
import struct
import subprocess
import sys
import traceback
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cache, partial
from hashlib import sha256
from io import BytesIO
from multiprocessing import get_context
from pathlib import Path
from random import Random
from typing import Any
from zlib import crc32

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, Header, Metadata
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray

from benchmarks.bodies import bench_human
from benchmarks.golden.made_motion import JOINTS, write_clip, write_stream
from benchmarks.recording import SHARED
from benchmarks.urdf import write_urdf
from hardware.clock import thread_cpu
from hardware.errors import RetargetError
from retarget.cli.application import command_of, session_options
from retarget.cli.run import run
from retarget.live.address import parse_address
from retarget.live.open_stream import read_recording as read_stream
from retarget.model.body import load_body
from retarget.model.robot import load_profile
from retarget.recording.read_run import read_recorded
from retarget.recording.reading import MAGIC, read_recording
from retarget.schema.catalogue import shipped_folder
from retarget.schema.performer import load_performer
from retarget.schema.priorities import load_priorities
from retarget.schema.scene import load_scene
from retarget.schema.strict_yaml import load
from retarget.setup.import_robot import read_robot
from retarget.sources.asf_amc import read_amc
from retarget.sources.files import ReadOptions
from retarget.sources.markers import MARKER_GROUPS, read_marker_table
from retarget.sources.open import open_source
from retarget.sources.skeletons import SMPL_NAMES
from retarget.sources.streams.mvn import SEGMENTS
from retarget.sources.streams.raw_record import RawReader, RawWriter
from retarget.web.recorded import open_recorded

CPU_S, MEMORY = 5.0, 1.5e9
"""What a case may take, s and bytes; the memory of its process is limited to twice as much, its time to 60 s."""
KEPT = Path("out/fuzz")
BATCH = 500
NUMBER, WORD = re.compile(rb"-?\d+(\.\d+)?([eE][-+]?\d+)?"), re.compile(rb"[A-Za-z_:<>/]{2,}")
VALUES = (0, 1, -1, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1)
HOSTILE = (
    *(b"0 -0 1e9 -1e9 1e308 -1e308 1e-320 nan inf -inf .inf 0x7fffffff 0o17 012 1_000 1:30 true null [] {} -").split(),
    *(str(value).encode() for value in VALUES),
    *(b"9" * 400, b"", b"\xd9\xa3", "é\u2028\U0001f600".encode(), b"\x00", b"a" * 5000, b"[" * 200, b"- " * 40),
)
FLOATS = tuple(struct.pack(form, value) for form in ("<f", "<d") for value in (np.nan, np.inf, 1e30, -1e-30, 0.5))


@dataclass(frozen=True)
class Kind:
    """A kind of file. share: of all cases, in parts. bend: makes a hostile file of one of the corpus."""

    suffix: str
    share: int
    read: Callable[[Path], object]
    files: tuple[bytes, ...]
    bend: Callable[[bytes, Random], bytes]


def bent(data: bytes, rng: Random) -> bytes:
    """Bytes that are changed in one to six places."""
    hurt = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        at, size = rng.randrange(len(hurt) + 1), rng.choice((1, 2, 4, 8, 40, 400))
        part, kind = bytes(hurt[at : at + size]), rng.randrange(10)
        if kind == 0 and part:
            hurt[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            hurt[at : at + size] = (rng.choice(VALUES) % 2 ** (8 * size)).to_bytes(size, rng.choice(("little", "big")))
        elif kind == 2:
            del hurt[at : at + size]
        elif kind == 3:
            place = rng.randrange(len(hurt) + 1)
            hurt[place:place] = part * rng.choice((1, 1, 2, 50))
        elif kind == 4:
            hurt[at : at + size] = rng.choice((rng.randbytes(size), rng.choice(FLOATS)))
        elif kind == 5 and rng.random() < 0.2:
            del hurt[at:]
        elif kind == 6:
            begin, end, place = (hurt.find(b"\n", rng.randrange(len(hurt) + 1)) + 1 for _ in range(3))
            hurt[place:place] = hurt[begin:end] if begin < end else b""
        elif found := (WORD if kind == 7 else NUMBER).search(hurt, at):
            other = WORD.search(hurt, rng.randrange(len(hurt))) if kind == 7 else None
            hurt[found.start() : found.end()] = other[0] if other else rng.choice(HOSTILE)
    return bytes(hurt)


def bent_mcap(data: bytes, rng: Random) -> bytes:
    """A recording of which a chunk or the session is bent, with its sum; one in three as any file."""
    if rng.random() < 0.3:
        return bent(data, rng)
    kept, made = (Header, Metadata, Chunk), RecordBuilder()
    records = [one for one in StreamReader(BytesIO(data), emit_chunks=True).records if isinstance(one, kept)]
    hurt = rng.choice(records[1:])
    if isinstance(hurt, Chunk):
        inside = bent(zstandard.decompress(hurt.data, hurt.uncompressed_size), rng)
        hurt.data, hurt.uncompressed_size = zstandard.compress(inside), len(inside)
        hurt.uncompressed_crc = crc32(inside)
    elif isinstance(hurt, Metadata):
        session = bent(hurt.metadata["session"].encode(), rng).decode(errors="replace")
        hurt.metadata |= {"session": session, "sha256": sha256(session.encode()).hexdigest()}
    for record in records:
        record.write(made)
    return MAGIC + bytes(made.end()) + MAGIC  # type: ignore[no-untyped-call]


def bent_npz(data: bytes, rng: Random) -> bytes:
    """An archive in which one array is bent; one in three as any file."""
    if rng.random() < 0.3:
        return bent(data, rng)
    out = BytesIO()
    with zipfile.ZipFile(BytesIO(data)) as archive, zipfile.ZipFile(out, "w") as made:
        hurt = rng.choice(archive.namelist())
        for name in archive.namelist():
            inside = archive.read(name)
            made.writestr(name, bent(inside, rng) if name == hurt else inside)
    return out.getvalue()


def bent_stream(data: bytes, rng: Random, *, folder: Path) -> bytes:
    """A raw recording in which datagrams are bent; one in three as any file."""
    if rng.random() < 0.3:
        return bent(data, rng)
    path, made = folder / "stream", folder / "bent"
    path.write_bytes(data)
    made.unlink(missing_ok=True)
    reader = RawReader(path)
    writer = RawWriter(made, url=reader.url)
    for row in reader:
        payload = bent(row.payload, rng) if rng.random() < 0.4 else row.payload
        time_ns = rng.choice((0, 2**63)) if rng.random() < 0.05 else round(row.time_s * 1e9)
        writer.append(payload, time_ns=time_ns, address="127.0.0.1", port=row.port)
    writer.close()
    return made.read_bytes()


BALL = "<collision><geometry><sphere radius='0.04'/></geometry></collision>"
"""The shape of every link of a URDF: a body without shapes is refused as a whole."""
SIZED = b"""<mujoco><compiler angle="radian"/><size nkey="2" nuserdata="10" nuser_geom="2" memory="20M"/>
<option timestep="0.002" iterations="10"/><custom><numeric name="n" size="5" data="1 2"/></custom>
<default><geom type="capsule" size="0.04 0.1"/></default>
<asset><texture name="t" type="2d" builtin="checker" width="64" height="64"/>
<texture name="s" type="skybox" builtin="gradient" width="16" height="96"/><material name="m" texture="t"/>
<mesh name="cone" builtin="cone" params="12 0.5" scale="0.1 0.1 0.1"/>
<hfield name="h" nrow="4" ncol="5" size="1 1 0.1 0.1"/></asset>
<worldbody><geom type="hfield" hfield="h"/>
<body name="trunk" pos="0 0 1"><freejoint/><geom user="1 2"/><camera name="c" resolution="16 12"/>
<body name="arm" pos="0 0.2 0"><joint name="j" axis="0 1 0" range="-1 1"/><geom type="mesh" mesh="cone"/>
<site name="p"/></body></body>
<replicate count="3" euler="0 0 1"><body pos="1 0 0"><joint axis="0 0 1"/><geom material="m"/></body></replicate>
<flexcomp name="f" type="grid" count="3 3 2" spacing="0.1 0.1 0.1" dim="3" mass="1" radius="0.01"/></worldbody>
<actuator><general joint="j" dyntype="user" actdim="2"/><position joint="j" nsample="3" delay="0.01"/></actuator>
<sensor><user name="u" dim="3"/><contact num="2"/><jointpos joint="j" nsample="3" delay="0.01"/></sensor></mujoco>"""
"""An MJCF that tells sizes, of which more than a robot needs are refused."""
TELLS = re.compile(
    rb'\b(nkey|nuser\w+|memory|nrow|ncol|count|width|height|size|dim|num|nsample|actdim|params|resolution)="[^"]*"'
)
LARGE = (b"1 1 1", *b"1 9 99 500 999 4000 5000 20000 90000 2000000000 99999999999 1e9 -1 inf 3G 0x7fffffff".split())


def bent_body(data: bytes, rng: Random) -> bytes:
    """A body in which sizes are changed, a part is repeated or an element of another body is put in; or as any file."""
    if rng.random() < 0.3:
        return bent(data, rng)
    for _ in range(rng.choice((1, 1, 2, 4))):
        kind, ends = rng.randrange(4), [found.end() for found in re.finditer(rb">", data)][:-1]
        told, at = list(TELLS.finditer(data)), rng.choice(ends or [0])
        if kind < 2 and told:
            one = rng.choice(told)
            value = b" ".join(rng.choice(LARGE) for _ in range(rng.choice((1, 1, 2, 3))))
            data = data[: one.start()] + one[1] + b'="' + value + b'"' + data[one.end() :]
        elif kind == 2:
            part = rng.choice(re.findall(rb"<[a-z]+ [^<>]*/>", SIZED))
            data = data[:at] + part * rng.choice((1, 1, 1, 20)) + data[at:]
        elif kind == 3:
            times = rng.choice((1, 2, 3))
            inside = rb'<body><joint/><geom size="0.1"/></body>' * rng.choice((1, 1, 30))
            opened = b'<replicate count="%s">' % rng.choice(LARGE)
            data = data[:at] + opened * times + inside + b"</replicate>" * times + data[at:]
    return data


def made_runs(folder: Path, clip: Path) -> dict[str, list[bytes]]:
    """Short runs of a human and of a robot, by suffix."""
    for robot in ("human", "op3"):
        words = ["run", "--robot", robot, "--end", "0.05", "--source", str(clip)]
        words += ["--save", str(folder / f"{robot}.npz"), "--record", str(folder / f"{robot}.mcap")]
        subprocess.run([sys.executable, "-m", "retarget", *words], check=True, capture_output=True)
    return {end: [path.read_bytes() for path in sorted(folder.glob(f"*{end}"))] for end in (".npz", ".mcap")}


def made_amc() -> tuple[bytes, bytes]:
    """The performer of `made_motion` as ASF and AMC: to each joint leads a bone that is stiff."""
    bones, motion, tree = list[str](), ["1", "root 0 90 0 0 0 0"], list[str]()
    for name, parent, at in JOINTS[1:]:
        length = float(np.linalg.norm(at))
        along = "direction {} {} {}".format(*np.divide(at, length))
        for bone, size, dof in ((f"to{name}", length, ()), (name, 0.0, ("dof rx ry rz", "limits (-180.0 180.0)"))):
            bones += ["begin", f"name {bone}", along, f"length {size}", "axis 0 0 0 XYZ", *dof, "end"]
        tree += [f"{'root' if parent == 'Hips' else parent} to{name}", f"to{name} {name}"]
        motion.append(f"{name} 1 2 3")
    root = [":units", "length 1.0", "angle deg", ":root", "order TX TY TZ RX RY RZ", "axis XYZ"]
    asf = [*root, "position 0 0 0", "orientation 0 0 0", ":bonedata", *bones, ":hierarchy", "begin", *tree, "end"]
    return "\n".join(asf).encode(), "\n".join([":FULLY-SPECIFIED", ":DEGREES", *motion, "2", *motion[1:]]).encode()


def made_c3d() -> bytes:
    """Markers of a person who stands."""
    from c3d import Writer

    labels = sorted({name for groups in MARKER_GROUPS.values() for group in groups for name in group})
    writer = Writer(point_rate=100.0, analog_rate=100.0, point_scale=-1.0)
    points = np.zeros((len(labels), 5), np.float32)
    points[:, :3] = np.random.default_rng(0).uniform(0.0, 1500.0, (len(labels), 3))
    writer.add_frames([(points, np.zeros((0, 1), np.float32))] * 3)
    writer.set_point_labels(labels)
    writer.set_screen_axis("+X", "+Z")
    out = BytesIO()
    writer.write(out)
    return out.getvalue()


def saved(**arrays: NDArray[Any]) -> bytes:
    """An NPZ."""
    out = BytesIO()
    np.savez(out, allow_pickle=False, **arrays)
    return out.getvalue()


def made_arrays() -> tuple[bytes, ...]:
    """Two frames of a person who stands, in the layouts of arrays."""
    at, labels = np.zeros((2, 22, 3)), np.array(["LKNE", "LANK", "LELB", "LWRI"])
    points = {"pelvis": 0.9, "hip": 0.85, "knee": 0.45, "ankle": 0.06, "foot": 0.02, "head": 1.55, "neck": 1.45}
    points |= {"collar": 1.4, "shoulder": 1.4, "elbow": 1.1, "wrist": 0.85, "spine1": 1.0, "spine2": 1.1, "spine3": 1.2}
    for row, name in enumerate(SMPL_NAMES[:22]):
        side = 1.0 if name.startswith("left") else -1.0 if name.startswith("right") else 0.0
        part = name.rpartition("_")[2]
        at[:, row] = (0.1 * (part == "foot"), 0.2 * side * (points[part] > 1.0) + 0.1 * side, points[part])
    still, turned = np.zeros((2, 156)), np.tile(np.eye(3), (2, 22, 1, 1))
    marked = {"marker_data": np.ones((2, 4, 3)), "marker_labels": labels}
    return (
        saved(poses=still, trans=at[:, 0], mocap_framerate=np.array(60.0), gender=np.array(b"female"), **marked),
        saved(global_orient=still[:, :3], body_pose=still[:, 3:72], transl=at[:, 0], fps=np.array(30.0)),
        saved(global_joint_positions=at, height=np.array(1.7)),
        saved(posed_joints=at[:, :, [1, 2, 0]], global_rot_mats=turned),
    )


def made_glb() -> bytes:
    """The performer of `made_motion` as nodes, of which the first turns."""
    names = [name for name, _, _ in JOINTS]
    below = {name: [names.index(child) for child, parent, _ in JOINTS if parent == name] for name in names}
    nodes = [{"name": name, "translation": [0.01 * x for x in at], "children": below[name]} for name, _, at in JOINTS]
    data = struct.pack("<2f", 0.0, 0.1) + struct.pack("<8f", *(0, 0, 0, 1) * 2)
    document = {
        "asset": {"version": "2.0"},
        "nodes": nodes,
        "animations": [
            {
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}],
                "samplers": [{"input": 0, "output": 1}],
            }
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 2, "type": "SCALAR"},
            {"bufferView": 1, "componentType": 5126, "count": 2, "type": "VEC4"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 8},
            {"buffer": 0, "byteOffset": 8, "byteLength": 32},
        ],
        "buffers": [{"byteLength": len(data)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def made_mvnx() -> bytes:
    """Two frames of a person in a T-pose."""
    places = {
        "Pelvis": "0 0 0.9",
        "L5": "0 0 1",
        "L3": "0 0 1.1",
        "T12": "0 0 1.2",
        "T8": "0 0 1.3",
        "Neck": "0 0 1.45",
    }
    places["Head"] = "0 0 1.55"
    for side, sign in (("Left", ""), ("Right", "-")):
        arm = (("Shoulder", "0.05"), ("UpperArm", "0.18"), ("ForeArm", "0.45"), ("Hand", "0.7"))
        leg = (("UpperLeg", "0.85"), ("LowerLeg", "0.45"), ("Foot", "0.06"), ("Toe", "0.02"))
        places |= {side + name: f"0 {sign}{left} 1.4" for name, left in arm}
        places |= {side + name: f"{0.15 * (name == 'Toe')} {sign}0.1 {up}" for name, up in leg}
    position = " ".join(places[name] for name in SEGMENTS)
    turns = "1 0 0 0 " * len(SEGMENTS)
    labels = "".join(f'<segment label="{name}"/>' for name in SEGMENTS)
    frame = f"<frame type='normal'><orientation>{turns}</orientation><position>{position}</position></frame>"
    return f"<mvnx><subject frameRate='60'><segments>{labels}</segments>{frame * 2}</subject></mvnx>".encode()


MADE_TRC = b"""\
PathFileType\t4\t(X/Y/Z)\ta.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits
60\t60\t2\t3\tmm
Frame#\tTime\tLFHD\t\t\tRFHD\t\t\tLWRA\t\t
\t\tX1\tY1\tZ1\tX2\tY2\tZ2\tX3\tY3\tZ3
1\t0\t80\t1640\t70\t80\t1640\t-70\t40\t1380\t700
2\t0.0167\t80\t1641\t70\t80\t1641\t-70\t\t\t
"""
MARKER_TABLE = b"""\
markers:
  head: [Head Top, HeadL, 3]
  l_wrist: [LWristIn, LWristOut]
"""


def corpus(folder: Path) -> list[Kind]:
    """Every kind of file, with what is made of it here and, where ../shared is, with short files of others."""
    configs, clip = shipped_folder(), write_clip(folder / "clip.bvh")
    runs, asf, amc, stream = made_runs(folder, clip), *made_amc(), write_stream(folder / "stream").read_bytes()[:1000]
    (folder / "good.asf").write_bytes(asf)
    (folder / "good.amc").write_bytes(amc)
    short = re.sub(rb"Frames: \d+", b"Frames: 3", clip.read_bytes())
    bvh = b"\n".join(short.splitlines()[: short[: short.index(b"Frames:")].count(b"\n") + 5])
    streams = [stream, *(path.read_bytes()[:700] for path in sorted(SHARED.glob("streams/*/*.udprec.gz")))]

    def yamls(kind: str) -> tuple[bytes, ...]:
        return tuple(path.read_bytes() for path in sorted((configs / kind).rglob("*.yaml")))

    def robot(path: Path) -> object:
        shutil.copyfile(configs / "robots/op3/body.xml", path.with_name("body.xml"))
        return load_profile(path)

    mjcf, human = ((configs / "robots/op3/body.xml").read_bytes(), SIZED), bench_human()
    urdf = write_urdf(human, dict.fromkeys(human.model.body_names, BALL)).encode()
    return [
        Kind(".mcap", 10, lambda path: read_recording(path).cycles, tuple(runs[".mcap"][:1]), bent_mcap),
        Kind(".mcap", 2, lambda path: read_recording(path).cycles, tuple(runs[".mcap"]), bent_mcap),
        Kind(".mcap", 1, open_recorded, tuple(runs[".mcap"]), bent_mcap),
        Kind(".npz", 8, lambda path: read_recorded(path, robot=False), tuple(runs[".npz"][:1]), bent_npz),
        Kind(".npz", 2, open_recorded, tuple(runs[".npz"]), bent_npz),
        Kind(".yaml", 2, robot, ((configs / "robots/op3/robot.yaml").read_bytes(),), bent),
        Kind(".yaml", 10, load_priorities, yamls("priorities"), bent),
        Kind(".yaml", 10, load_performer, yamls("performers"), bent),
        Kind(".yaml", 10, load_scene, yamls("scenes"), bent),
        Kind(".yaml", 4, read_marker_table, (MARKER_TABLE,), bent),
        Kind(".yaml", 1, lambda path: session_options(load(path), command_of(run)), yamls("sessions"), bent),
        Kind(".xml", 6, load_body, mjcf, bent_body),
        Kind(".xml", 2, import_body, mjcf, bent_body),
        Kind(".urdf", 4, load_body, (urdf,), bent_body),
        Kind(".urdf", 4, import_body, (urdf,), bent_body),
        Kind(".bvh", 10, open_source, (bvh,), bent),
        Kind(".amc", 6, lambda path: read_amc(path, ReadOptions(skeleton=folder / "good.asf")), (amc,), bent),
        Kind(".asf", 6, lambda path: read_amc(folder / "good.amc", ReadOptions(skeleton=path)), (asf,), bent),
        Kind(".c3d", 8, open_source, (made_c3d(),), bent),
        Kind(".npz", 6, open_any, made_arrays(), bent_npz),
        Kind(".glb", 6, open_any, (made_glb(),), bent),
        Kind(".mvnx", 4, open_any, (made_mvnx(),), bent),
        Kind(".trc", 4, open_any, (MADE_TRC,), bent),
        Kind(".raw", 6, _read_stream, tuple(streams), partial(bent_stream, folder=folder)),
    ]


def open_any(path: Path) -> object:
    """A motion file, with a rate where it has none."""
    return open_source(path, rate=30.0)


def import_body(path: Path) -> object:
    """The body that `retarget import` writes, and the links that it proposes."""
    return read_robot(path)


def _read_stream(path: Path) -> object:
    return read_stream(parse_address(f"replay://{path}"))


@dataclass(frozen=True)
class Outcome:
    """Of some cases. slowest: CPU time in s, and of which; memory: most of a process, bytes; failed: names and why."""

    cases: int = 0
    refused: int = 0
    slowest: tuple[float, str] = (0.0, "")
    memory: int = 0
    failed: tuple[tuple[str, str], ...] = ()

    def __add__(self, other: "Outcome") -> "Outcome":
        """Both."""
        counts = self.cases + other.cases, self.refused + other.refused
        worst = max(self.slowest, other.slowest), max(self.memory, other.memory)
        return Outcome(*counts, *worst, self.failed + other.failed)


def try_case(kinds: list[Kind], number: int, *, seed: int, folder: Path) -> Outcome:
    """Read the file of one case; it stays in the folder."""
    rng = Random(f"{seed} {number}")
    (kind,) = rng.choices(kinds, [kind.share for kind in kinds])
    path, name, why, refused = folder / f"case{kind.suffix}", f"{seed}-{number}{kind.suffix}", "", False
    path.write_bytes(kind.bend(rng.choice(kind.files), rng))
    began, before = _cpu(), _memory()
    try:
        with np.errstate(all="ignore"):
            kind.read(path)
    except RetargetError as error:
        refused, why = True, "" if str(error).strip() else f"{type(error).__name__} without a text"
    except Exception as error:  # noqa: BLE001 - any is what is looked for
        last = traceback.extract_tb(error.__traceback__)[-1]
        why = f"{type(error).__name__} in {Path(last.filename).name}:{last.lineno}: {str(error)[:80]!r}"
    took, memory = _cpu() - began, _memory()
    if took > CPU_S or memory > max(MEMORY, before):
        why = why or f"{took:.1f} s, {memory / 1e9:.1f} GB"
    if why:
        KEPT.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, KEPT / name)
    return Outcome(1, refused, (took, name), memory, ((name, why),) if why else ())


def _memory() -> int:
    """Most that this process or a child of it had, bytes."""
    return 1024 * max(resource.getrusage(whose).ru_maxrss for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def _cpu() -> float:
    """Time of a processor that this thread and children that have ended took, s."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return thread_cpu() + children.ru_utime + children.ru_stime


@cache
def _at_work(only: str | None) -> tuple[list[Kind], Path]:
    """The corpus of this process, or its kinds of these suffixes, and its folder; from then on its memory is
    limited."""
    folder = KEPT / f"process-{os.getpid()}"
    folder.mkdir(parents=True)
    kinds = [kind for kind in corpus(folder) if only is None or kind.suffix in only.split(",")]
    warnings.simplefilter("ignore")
    used = 4096 * int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (used + round(2 * MEMORY),) * 2)
    return kinds, folder


def try_cases(numbers: range, *, seed: int, only: str | None = None) -> Outcome:
    """Read the files of some cases in this process, which ends with a case that takes a minute."""
    kinds, folder = _at_work(only)
    outcome = Outcome()
    for number in numbers:
        signal.alarm(60)
        outcome += try_case(kinds, number, seed=seed, folder=folder)
    signal.alarm(0)
    return outcome


def main() -> int:
    """The command. Returns its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", help="kinds by their suffix, with commas: .xml,.urdf")
    asked = parser.parse_args()
    batches = [range(first, min(first + BATCH, asked.cases)) for first in range(0, asked.cases, BATCH)]
    shutil.rmtree(KEPT, ignore_errors=True)
    total, seen = Outcome(), Counter[str]()
    with ProcessPoolExecutor(asked.jobs, mp_context=get_context("spawn")) as pool:
        try:
            for done in pool.map(partial(try_cases, seed=asked.seed, only=asked.only), batches):
                total += done
                for name, why in done.failed:
                    seen[why.partition(": ")[0]] += 1
                    if seen[why.partition(": ")[0]] <= 3:
                        print(f"FAILED {KEPT / name}: {why}", flush=True)
                if total.cases % (20 * BATCH) == 0 or total.cases == asked.cases:
                    slowest, memory = f"{total.slowest[0]:.2f} s ({total.slowest[1]})", f"{total.memory / 1e6:.0f} MB"
                    counts = f"{total.cases} cases, {total.refused} refused, {len(total.failed)} failed"
                    print(f"seed {asked.seed}: {counts}, slowest {slowest}, most memory {memory}", flush=True)
        except BrokenProcessPool:
            print(f"FAILED a process ended, or took a minute: {[*map(str, KEPT.glob('process-*/case*'))]}", flush=True)
            return 1
    for why, count in seen.most_common():
        print(f"{count} x {why}")
    return 1 if total.failed else 0


if __name__ == "__main__":
    sys.exit(main())
