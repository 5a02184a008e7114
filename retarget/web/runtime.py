"""The body tracker that the page of `web://` runs in the browser: fetched once, checked, and kept in the cache.

Two packages of the npm registry have the code (MediaPipe's tasks-vision) and the models (its older pose package), both
Apache-2.0. The first is pinned, since later versions send usage data.
"""

import hashlib
import io
import shutil
import struct
import subprocess
import tarfile
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from retarget.errors import InputError, UsageError
from retarget.schema.catalogue import cache_folder
from retarget.schema.files import write_folder

WHERE = "retarget web install"
"""The command, for messages."""
FETCH_S = 900
"""Longest time, s, for one package: 41 MB over a line of 0.4 Mbit/s."""
LARGEST = 100_000_000
"""Largest archive, bytes. The larger of the two has 41 million."""


@dataclass(frozen=True, slots=True)
class Package:
    """A package of the npm registry. sha256: of its archive."""

    name: str
    version: str
    sha256: str

    @property
    def spec(self) -> str:
        """Name and version for the npm client."""
        return f"{self.name}@{self.version}"


VISION = Package(
    "@mediapipe/tasks-vision", "0.10.35", "84597a25e13d123b5f4cbe768bb72e97a2c28c7a465f0ace287d8cbe5246bff0"
)
POSE = Package("@mediapipe/pose", "0.5.1675469404", "8bb349a7b3a3ba699df23be804ddd3b3eab810b50b15406894be257859388a84")
FOLDER = f"tasks-vision-{VISION.version}-pose-{POSE.version}"
MODEL = "pose_landmarker_lite.task"
"""The bundle of both models: detector of a person, and landmarks."""
BUNDLE = "vision_bundle.mjs"
FILES = (BUNDLE, "wasm/vision_wasm_module_internal.js", "wasm/vision_wasm_module_internal.wasm", MODEL)
"""Files that are required."""


def runtime_folder() -> Path | None:
    """The folder with FILES, or None if they are not installed."""
    folder = _folder()
    return folder if all((folder / name).is_file() for name in FILES) else None


def install(archives: Sequence[Path] | None, notify: Callable[[str], object]) -> Path:
    """Install the runtime in the cache, whole or not at all, and return its folder.

    archives: both packages of `npm pack` (.tgz); None fetches them with the npm client. notify: receives progress.
    Raises UsageError without npm or network, InputError for other archives.
    """
    if archives is None:
        with tempfile.TemporaryDirectory() as folder:
            paths = []
            for package in (VISION, POSE):
                notify(f"fetching {package.spec}")
                paths.append(_fetched(package, Path(folder)))
            found = _checked(paths)
    else:
        found = _checked(archives)
    notify("checked; writing the model bundle")
    vision, pose = _members(found[VISION]), _members(found[POSE])
    contents = {name: data for name, data in vision.items() if name == BUNDLE or name.startswith("wasm/")}
    contents[MODEL] = _bundle(pose["pose_solution_packed_assets.data"], pose["pose_landmark_lite.tflite"])
    contents["NOTICE.txt"] = (
        f"From the npm packages {VISION.spec} and {POSE.spec}: MediaPipe, Apache License 2.0.\n"
        f"{MODEL}: their two models with metadata added.\n"
    ).encode()
    write_folder(_folder(), contents, option=WHERE)
    return _folder()


def _folder() -> Path:
    return cache_folder() / "web" / FOLDER


def _fetched(package: Package, folder: Path) -> Path:
    npm = shutil.which("npm")
    specs = " ".join(one.spec for one in (VISION, POSE))
    by_hand = f"on a machine that has both, run: npm pack {specs}; and give the two .tgz files to {WHERE}"
    if npm is None:
        raise UsageError(
            "there is no npm client", where=WHERE, next_step=f"Install npm (part of Node.js); or {by_hand}"
        )
    command = [npm, "pack", "--loglevel=error", "--fetch-retries=1", "--pack-destination", str(folder), package.spec]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=FETCH_S, check=False)
        lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
        why = lines[0][:200] if lines else f"exit code {done.returncode}"  # the first names the fault
    except (OSError, subprocess.TimeoutExpired) as error:
        done, why = None, str(error)[:200]
    archives = sorted(folder.glob(f"{package.name.lstrip('@').replace('/', '-')}-*.tgz"))
    if done is None or done.returncode != 0 or not archives:
        step = f"See that this machine is online; or {by_hand}"
        raise UsageError(f"npm could not fetch {package.spec}", where=WHERE, found=why, next_step=step)
    return archives[0]


def _checked(paths: Sequence[Path]) -> dict[Package, bytes]:
    packages, found = {package.sha256: package for package in (VISION, POSE)}, dict[Package, bytes]()
    allowed = " and ".join(package.spec for package in packages.values())
    for path in paths:
        try:
            with path.open("rb") as stream:
                data = stream.read(LARGEST)
        except OSError as error:
            raise InputError(
                "cannot read this archive", where=str(path)[:200], found=error.strerror or error
            ) from error
        checksum = hashlib.sha256(data).hexdigest()
        if checksum not in packages:
            raise InputError(
                "this archive is damaged, or of another package or version",
                where=str(path)[:200],
                found=f"SHA-256 {checksum}",
                allowed=f"{allowed}, as npm pack writes them",
                next_step=f"Fetch it again: npm pack {' '.join(package.spec for package in packages.values())}",
            )
        found[packages[checksum]] = data
    if missing := [package.spec for package in packages.values() if package not in found]:
        step = f"Fetch it: npm pack {' '.join(missing)}"
        raise InputError("an archive is missing", where=WHERE, found=f"no {', no '.join(missing)}", next_step=step)
    return found


def _members(archive: bytes) -> dict[str, bytes]:
    with tarfile.open(fileobj=io.BytesIO(archive), mode="r:gz") as tar:
        files = [(one.name.partition("/")[2], tar.extractfile(one)) for one in tar if one.isfile()]
        return {name: stream.read() for name, stream in files if stream is not None}


def _bundle(detector: bytes, landmarks: bytes) -> bytes:
    """The model bundle: a stored zip of both models, with the scaling of their inputs."""
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w", zipfile.ZIP_STORED) as bundle:
        for name, model, mean, deviation in (
            ("pose_detector.tflite", detector, 127.5, 127.5),  # pixels become -1 to 1
            ("pose_landmarks_detector.tflite", landmarks, 0.0, 255.0),  # pixels become 0 to 1
        ):
            # The fixed date makes the bytes reproducible.
            bundle.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), with_scaling(model, mean, deviation))
    return written.getvalue()


# The metadata of a TensorFlow Lite model (a FlatBuffer, schema.fbs) are a FlatBuffer (metadata_schema.fbs of TensorFlow
# Lite Support) in one of its buffers. Offsets in a FlatBuffer are unsigned and relative to their own place, so all
# point forward. A new root table stands in front of the unchanged old bytes and points into them.

_TEXT = "TFLITE_METADATA"
"""Name of the metadata in a model."""
_BUFFERS, _METADATA = 4, 6
"""Fields of a model: buffers, and a list of (name, number of a buffer)."""


def with_scaling(model: bytes, mean: float, deviation: float) -> bytes:
    """A model (.tflite) of one picture whose input is scaled: (pixel - mean) / deviation, of values 0 to 255."""
    scaling = {0: 1, 1: {0: [mean], 1: [deviation]}}  # options: NormalizationOptions
    content = {0: 2, 1: {0: 1}}  # content_properties: ImageProperties of colour space RGB
    tensor = {0: "image", 3: content, 4: [scaling]}
    metadata = _encoded({0: "pose", 3: [{2: [tensor]}]}, b"M001")
    fields = _fields(model, _uint(model, 0))
    buffers = [_Old(at) for at in _listed(model, fields[_BUFFERS])]
    entries = [_Old(at) for at in _listed(model, fields[_METADATA])] if _METADATA in fields else []
    new: Table = {0: _uint(model, fields[0])}  # version of the schema; all other fields are offsets
    new |= {slot: _Old(at + _uint(model, at)) for slot, at in fields.items() if slot != 0}
    new[_BUFFERS] = [*buffers, {0: metadata}]
    new[_METADATA] = [*entries, {0: _TEXT, 1: len(buffers)}]
    return _encoded(new, model[4:8], behind=model)


Table = dict[int, Any]
"""A table: slot -> 32-bit integer, text, bytes, table, `_Old`, or a list of numbers, tables or `_Old`."""


@dataclass(frozen=True, slots=True)
class _Old:
    at: int


def _uint(data: bytes, at: int) -> int:
    return int(struct.unpack_from("<I", data, at)[0])


def _fields(data: bytes, table: int) -> dict[int, int]:
    layout = table - struct.unpack_from("<i", data, table)[0]
    size = struct.unpack_from("<H", data, layout)[0]
    offsets = struct.unpack_from(f"<{size // 2 - 2}H", data, layout + 4)
    return {slot: table + offset for slot, offset in enumerate(offsets) if offset}


def _listed(data: bytes, field: int) -> list[int]:
    """Places of the tables of the list that a field points to."""
    start = field + _uint(data, field)
    places = range(start + 4, start + 4 + 4 * _uint(data, start), 4)
    return [at + _uint(data, at) for at in places]


def _encoded(root: Table, identifier: bytes, *, behind: bytes = b"") -> bytes:
    """Encode a FlatBuffer with this root, in front of old bytes. Each object stands behind the offset to it."""
    out = bytearray(struct.pack("<I4s", 0, identifier))
    pending: list[tuple[int, Any]] = [(0, root)]  # place of an offset, and its target
    old: list[tuple[int, int]] = []
    for place, node in pending:  # the list grows meanwhile
        if isinstance(node, _Old):
            old.append((place, node.at))
            continue
        start = _append(out, node, pending)
        struct.pack_into("<I", out, place, start - place)
    out += bytes(-len(out) % 16)  # keeps the alignment of the old bytes
    for place, at in old:
        struct.pack_into("<I", out, place, len(out) + at - place)
    return bytes(out) + behind


def _append(out: bytearray, node: Any, pending: list[tuple[int, Any]]) -> int:
    """Append one node to `out`, and its targets to `pending`. Returns its place."""
    out += bytes(-len(out) % 4)
    cells: list[Any]
    if isinstance(node, dict):
        last = max(node)
        places = {slot: 4 + 4 * number for number, slot in enumerate(node)}
        layout = [2 * last + 6, 4 + 4 * len(places), *(places.get(slot, 0) for slot in range(last + 1))]
        out += bytes(-(len(out) + 2 * len(layout)) % 4)
        out += struct.pack(f"<{len(layout)}H", *layout)
        start, cells = len(out), list(node.values())
        out += struct.pack("<i", 2 * len(layout))  # the layout stands right before
    elif isinstance(node, list):
        start, cells = len(out), node
        out += struct.pack("<I", len(node))
    else:
        raw = node.encode() + b"\0" if isinstance(node, str) else node
        out += bytes(-(len(out) + 4) % 16)  # data of a model begin at multiples of 16 bytes
        start, cells = len(out), []
        out += struct.pack("<I", len(node)) + raw
    for cell in cells:
        if isinstance(cell, float):
            out += struct.pack("<f", cell)
        elif isinstance(cell, int):
            out += struct.pack("<I", cell)
        else:
            pending.append((len(out), cell))
            out += bytes(4)
    return start
