"""The body file of an import: reads it, finds its meshes, and prepares a URDF for MuJoCo."""

import copy
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from itertools import takewhile
from math import isfinite
from pathlib import Path
from shlex import quote
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError, Problem, install_step
from retarget.model.body_xml import MAX_BYTES, body_xml, read_body
from retarget.schema import strict_models
from retarget.types import FloatArray


@dataclass(frozen=True, eq=False)
class Source:
    """A body file. kind: urdf or mjcf; root: its outermost element."""

    path: Path
    kind: str
    content: bytes
    root: ElementTree.Element

    @property
    def name(self) -> str:
        """Name of the robot in the file, else name of the file."""
        return (self.root.get("name") or self.root.get("model") or self.path.stem).strip() or self.path.stem


def read_source(path: Path) -> Source:
    """Read a body file with all files that it includes. Raises InputError, for motions and configurations with the
    command that takes them."""
    from retarget.sources.open import SUFFIXES

    name, suffix = quote(str(path)), path.suffix.lower()
    if path.is_file() and suffix[1:] in SUFFIXES:
        step = f"Follow it: retarget run {name}"
        raise InputError("this is a motion, not a robot's body", where=str(path), next_step=step)
    if (path / "robot.yaml").is_file() or (path.is_file() and suffix in (".yaml", ".yml")):
        step = f"Check it: retarget check {name}"
        raise InputError("this is a configuration, not a robot's body", where=str(path), next_step=step)
    content = read_body(path)
    xml = body_xml(content, source=str(path), folder=path.parent)
    return Source(path, xml.kind, content, xml.root)


# The files of meshes.

COLLADA = ".dae"
OF_MUJOCO = (".stl", ".obj", ".msh")
"""Meshes that MuJoCo reads."""
READABLE = (*OF_MUJOCO, COLLADA)
PACKAGE_DEPTH = 6
"""Folders above the body in which its package may be."""
MOST_FILES = 20_000
"""Most files below a folder that are searched."""
MOST_FACES = 200_000
"""Most triangles of an STL file in MuJoCo."""
_PLACE = re.compile(r"^\w+://|\$\(find\s+([^)]*)\)")
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")
_ENTITY = re.compile(rb"<!(?:DOCTYPE|ENTITY)")


class MeshFiles:
    """The meshes of a body file, each read once. names: in the file, by their names in MuJoCo. contents: their bytes.
    problems: files that exist but cannot be read."""

    def __init__(self, body: Path, *, leaves_out: bool = False) -> None:
        """body: the file. leaves_out: treat unreadable COLLADA files as missing."""
        self._body, self._leaves_out = body, leaves_out
        self._indices: dict[Path, dict[str, list[Path]]] = {}
        self.names: dict[str, str] = {}
        self.contents: dict[str, bytes] = {}
        self.problems: list[Problem] = []

    def find(self, name: str) -> Path | None:
        """The file of a name, else the longest match of the end of its path in the body's folder or package, in
        any case; None if there is none. A file that MuJoCo reads is preferred to a COLLADA file beside it."""
        try:
            return self._find(name)
        except (OSError, ValueError):
            return None

    def _find(self, name: str) -> Path | None:
        parts = [part for part in _PLACE.sub(r"\1", name.replace("\\", "/")).split("/") if part not in ("", ".")]
        parts = [unquote(part) for part in parts] if "://" in name else parts
        ups = parts.count("..")
        tail = parts[ups:]
        if not tail:
            return None
        folder = self._body.absolute().parent
        places = [folder.joinpath(*parts), Path("/", *parts)]
        exact = [place for place in places if _is_mesh(place)]
        if exact and exact[0].suffix.lower() in OF_MUJOCO:
            return exact[0]
        above = [one for one in folder.parents[:PACKAGE_DEPTH] if (one / tail[0]).is_dir() or one.name == tail[0]]
        roots = [folder.joinpath(*parts[:ups]), *(above if len(tail) > 1 else [])]
        below = (found for root in roots if (found := self._below(root, tail)) is not None)
        return next(below, None) or next(iter(exact), None)

    def _below(self, root: Path, tail: list[str]) -> Path | None:
        """The file below a folder whose path has the longest match with the end of `tail`."""
        root = Path(os.path.normpath(root))
        if root not in self._indices:
            index = self._indices[root] = dict[str, list[Path]]()
            seen = 0
            for place, folders, files in os.walk(root):
                folders[:] = sorted(folder for folder in folders if not folder.startswith("."))
                seen += len(files) + len(folders)
                for file in sorted(files):
                    index.setdefault(file.lower(), []).append(Path(place, file))
                if seen > MOST_FILES:
                    break
        end, found = [part.lower() for part in tail], list[tuple[int, bool, int, Path]]()
        stem, _, suffix = end[-1].rpartition(".")
        for file in [end[-1]] if f".{suffix}" in OF_MUJOCO else [stem + kind for kind in READABLE]:
            for path in self._indices[root].get(file, ()):
                folders = [part.lower() for part in path.relative_to(root).parts[:-1]]
                both = zip(reversed(folders), reversed(end[:-1]), strict=False)
                alike = len(list(takewhile(lambda pair: pair[0] == pair[1], both)))
                slow = path.suffix.lower() == COLLADA
                found += [(-alike, slow, len(folders), path)] if _is_mesh(path) else []
        return min(found)[-1] if found else None

    def read(self, name: str) -> str | None:
        """Read a mesh, and return its name in MuJoCo; None if there is no such file."""
        known = {user: own for own, user in self.names.items()}
        if name in known:
            return known[name]
        path = self.find(name)
        if path is None:
            return None
        suffix, content = path.suffix.lower(), path.read_bytes()
        if suffix == COLLADA:
            try:
                corners = collada_triangles(content, source=str(path))
            except InputError as error:
                if self._leaves_out:
                    return None
                self.problems += [one for one in error.problems if one not in self.problems]
                content = b""  # no problem of its own
            else:
                content = self._checked(binary_stl(corners), len(corners), path)
            suffix = ".stl"
        elif suffix == ".stl":
            content = self._binary(content, path)
        key = f"mesh_{len(self.names)}{suffix}"
        self.names[key], self.contents[key] = name, content
        return key

    def _binary(self, content: bytes, path: Path) -> bytes:
        """Convert an STL file, which may be text, to the binary form that MuJoCo reads."""
        faces = int.from_bytes(content[80:84], "little")
        if content[:5].lower() == b"solid" and len(content) != 84 + 50 * faces:
            try:
                ends = content.rstrip().rpartition(b"\n")[2].lower().lstrip().startswith(b"endsolid")
                corners = np.array(_VERTEX.findall(content) if ends else [], dtype=np.float32).reshape(-1, 3, 3)
            except ValueError:
                corners = np.zeros((0, 3, 3), dtype=np.float32)
            content, faces = binary_stl(corners), len(corners)
        return self._checked(content, faces, path)

    def _checked(self, content: bytes, faces: int, path: Path) -> bytes:
        if not 0 < faces <= MOST_FACES or len(content) < 84 + 50 * faces:
            allowed = f"a mesh (STL: binary, or text up to its endsolid) of 1 to {MOST_FACES} triangles"
            step = "Export it again, with fewer triangles (decimated) where there are too many"
            self.problems.append(Problem("a mesh that cannot be read", str(path), f"{faces} triangles", allowed, step))
        return content

    def in_words(self, text: str) -> str:
        """Replace names of MuJoCo in a message by those in the body file."""
        for key, name in sorted(self.names.items(), key=lambda item: -len(item[0])):
            text = text.replace(key, name).replace(f"'{Path(key).stem}'", f"'{name}'")
        return text


def _is_mesh(path: Path) -> bool:
    return path.suffix.lower() in READABLE and path.is_file() and 0 < path.stat().st_size <= MAX_BYTES


def missing_meshes(names: list[str], source: Source) -> Problem:
    """The problem of meshes without which a link has no shape."""
    return Problem(
        "meshes that cannot be read, without which soles and hands cannot be found",
        str(source.path),
        listed(names),
        f"files {', '.join(READABLE)}, below the folder of the body file, or in its package above it",
        "Put them there, or give --no-meshes to leave them out",
    )


def collada_triangles(content: bytes, *, source: str) -> FloatArray:
    """The triangles (t, 3, 3), m, of the scene of a COLLADA file, in the axes of the file: `up_axis` is ignored,
    as in ROS (rviz, Gazebo). Raises InputError without pycollada, or if it cannot read the file."""
    try:
        import collada
    except ImportError:
        what = "COLLADA meshes (.dae) need pycollada"
        raise InputError(
            what, next_step=install_step("pycollada") + ", or give --no-meshes to leave them out"
        ) from None
    try:
        if _ENTITY.search(content):
            raise ValueError("entities, which no mesh needs")
        # Errors of materials and pictures do not matter here.
        file = collada.Collada(BytesIO(content), ignore=[collada.common.DaeError])
        metres = float(file.assetInfo.unitmeter or 1.0)
        placed = [] if file.scene is None else [*file.scene.objects("geometry")]
        found = [_corners(part) for one in placed for part in one.primitives()]
    except Exception as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        step = "Export it again, or convert it to .stl beside it"
        raise InputError("a mesh that cannot be read", where=source, found=reason[0][:200], next_step=step) from error
    return metres * np.concatenate([np.zeros((0, 3, 3)), *found])


def _corners(primitive: Any) -> FloatArray:
    """Corners (t, 3, 3) of a bound primitive of triangles or polygons; none of lines."""
    if hasattr(primitive, "triangleset"):
        primitive = primitive.triangleset()
    index = primitive.vertex_index
    if index is None or index.ndim != 2 or index.shape[1] != 3:
        return np.zeros((0, 3, 3))
    corners: FloatArray = np.asarray(primitive.vertex, dtype=float)[index]
    return corners


def binary_stl(corners: NDArray[np.floating[Any]]) -> bytes:
    """Return triangles (t, 3, 3) as a binary STL file."""
    rows = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    rows["corners"] = corners
    return bytes(80) + len(corners).to_bytes(4, "little") + rows.tobytes()


# Preparation of a URDF: limits, joints without servo, links without mass, meshes.

TURNS = ("revolute", "continuous")
KNOWN = (*TURNS, "fixed", "prismatic", "floating", "planar")
SHAPES = ("collision", "visual")
INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


@dataclass(frozen=True, eq=False)
class ReadyUrdf:
    """A prepared URDF. notes: changes. limited: names of joints with limits. speeds: joint -> rad/s in the file.
    welded: True if its torso is fixed to a link `world`."""

    text: str
    notes: list[str]
    limited: frozenset[str] = frozenset()
    speeds: dict[str, float] = field(default_factory=dict)
    welded: bool = False


def ready_urdf(source: Source, meshes: MeshFiles, *, no_meshes: bool, looks: bool = False) -> ReadyUrdf:
    """Prepare a URDF, and read its meshes. no_meshes: leave out unreadable meshes. looks: also keep <visual> shapes of
    links with <collision> shapes. Raises InputError with all of its problems."""
    root, notes = copy.deepcopy(source.root), list[str]()
    problems = [
        *_joints(root, source, notes),
        *_masses(root, source, notes),
        *_meshes(root, source, meshes, notes, no_meshes=no_meshes, looks=looks),
        *meshes.problems,
    ]
    if problems:
        raise InputError.from_problems(problems, title=f"{source.path}: {len(problems)} problems")
    speeds = {joint.get("name", ""): _limit(joint, "velocity") for joint in root.iter("joint")}
    speeds = {name: speed for name, speed in speeds.items() if 0.0 < speed < 1e3}
    above = {
        one.get("link", "").lower() for joint in root.iterfind("joint[@type='fixed']") for one in joint.iter("parent")
    }
    limited = frozenset(joint.get("name", "") for joint in root.iterfind("joint[@type='revolute']"))
    return ReadyUrdf(ElementTree.tostring(root, encoding="unicode"), notes, limited, speeds, welded="world" in above)


def _joints(root: ElementTree.Element, source: Source, notes: list[str]) -> Iterator[Problem]:
    """Make joints without a servo of their own rigid, and limit continuous joints that have limits."""
    found: dict[str, list[str]] = {}
    bounded = list[str]()
    for joint in root.findall("joint"):
        kind, name = joint.get("type", ""), joint.get("name", "without a name")
        if kind not in KNOWN:
            yield Problem("no such type of joint", str(source.path), f"{name}: {kind!r}", ", ".join(KNOWN))
        mimic = joint.find("mimic")
        if mimic is not None and kind in TURNS:
            kind = "mimic"
        if kind not in (*TURNS, "fixed") and kind in (*KNOWN, "mimic"):
            found.setdefault(kind, []).append(name)
            joint.set("type", "fixed")
            if mimic is not None:
                joint.remove(mimic)
        low, high = (_limit(joint, key) for key in ("lower", "upper"))
        if kind in TURNS and not isfinite(low + high):
            step = "Write numbers in rad, the lower one first"
            yield Problem("limits that are no numbers", str(source.path), f"joint {name}", next_step=step)
        if kind == "continuous" and low < high:
            joint.set("type", "revolute")
            bounded.append(f"{name} ({low:g} to {high:g})")
    notes += [f"continuous joints that state limits, which are kept: {listed(bounded)}"] if bounded else []
    notes += [f"{kind} joints, which no servo drives, made rigid: {listed(names)}" for kind, names in found.items()]


def _limit(joint: ElementTree.Element, key: str) -> float:
    """A number of a joint's <limit>, 0 if it is absent, as in URDF, NaN if it is not a number."""
    limit = joint.find("limit")
    return 0.0 if limit is None or limit.get(key) is None else _number(limit.get(key))


def _masses(root: ElementTree.Element, source: Source, notes: list[str]) -> Iterator[Problem]:
    """Problems of <inertial>, each with all of its links, and of a robot without mass, which cannot be balanced. Adds a
    note on links with a shape and no mass."""
    links, found = root.findall("link"), dict[str, list[str]]()
    bare, heavy = [], False
    for link in links:
        inertial, name = link.find("inertial"), link.get("name", "without a name")
        if inertial is None:
            bare += [name] if any(link.find(kind) is not None for kind in SHAPES) else []
            continue
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        value = float("nan") if mass is None else _number(mass.get("value"))
        heavy = heavy or value > 0.0
        if not 0.0 <= value < float("inf"):
            found.setdefault("no <mass> of 0 kg or more", []).append(name)
        if inertia is None or not all(isfinite(_number(inertia.get(key, "0"))) for key in INERTIA):
            found.setdefault("no <inertia> of six numbers", []).append(name)
    for what, names in found.items():
        step = "Correct it, or remove <inertial>: then the link weighs nothing"
        yield Problem(f"links with an <inertial> that has {what}", str(source.path), listed(names), "", step)
    if links and not heavy:
        yield Problem(
            "no link has a mass, so its balance cannot be checked",
            str(source.path),
            f"{len(links)} links without <inertial>, or with a mass of 0",
            next_step="Add <inertial> with mass, origin and inertia to every link that weighs something",
        )
    elif bare:
        notes.append(f"links with a shape but without <inertial> weigh nothing here: {listed(bare)}")


def _number(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return float("nan")


def _meshes(
    root: ElementTree.Element, source: Source, meshes: MeshFiles, notes: list[str], *, no_meshes: bool, looks: bool
) -> Iterator[Problem]:
    """Keep the <collision> shapes of each link, and its <visual> ones if the former are incomplete or absent.
    Unreadable meshes are problems if neither kind is complete. looks: also keep readable <visual> shapes beside
    complete <collision> ones."""
    missing, dropped = dict[str, None](), list[str]()
    for link in root.findall("link"):
        shapes, unread = [link.findall(kind) for kind in SHAPES], list[str]()
        usable, complete = list[ElementTree.Element](), False
        for kind in shapes:
            found = [] if complete else [shape for shape in kind if _is_read(shape, meshes, unread)]
            usable += found
            complete = complete or 0 < len(kind) == len(found)
        beside = looks and complete and all(shape in shapes[0] for shape in usable)
        seen = shapes[1] if beside and all(_is_read(shape, meshes, []) for shape in shapes[1]) else []
        for shape in (*shapes[0], *shapes[1]):
            if shape in seen:
                continue
            shape.tag = "collision"
            if shape not in usable:
                link.remove(shape)
        if unread and not complete:
            missing |= dict.fromkeys(unread)
        elif unread:
            dropped.append(f"{link.get('name', 'without a name')} ({unread[0]})")
    if root.find("link/visual") is not None:  # MuJoCo drops them, unless it is asked to keep them
        extension = root.find("mujoco")
        extension = ElementTree.SubElement(root, "mujoco") if extension is None else extension
        compiler = extension.find("compiler")
        compiler = ElementTree.SubElement(extension, "compiler") if compiler is None else compiler
        compiler.set("discardvisual", "false")
    if missing and not no_meshes:
        yield missing_meshes(list(missing), source)
    for note, names in (
        (f"{len(missing)} meshes that cannot be read are left out", list(missing)),
        ("meshes that cannot be read are left out, these links have other shapes", dropped),
    ):
        notes += [f"{note}: {listed(names)}"] if names else []


def _is_read(shape: ElementTree.Element, meshes: MeshFiles, unread: list[str]) -> bool:
    mesh = shape.find("geometry/mesh")
    if mesh is None:
        return True
    name = mesh.get("filename", "")
    key = meshes.read(name)
    if key is None:
        unread.append(name)
        return False
    mesh.set("filename", key)
    return True


def listed(names: list[str]) -> str:
    """The first names, and the number of the others."""
    return strict_models.listed((name if len(name) <= 60 else f"...{name[-57:]}" for name in names), limit=8)
