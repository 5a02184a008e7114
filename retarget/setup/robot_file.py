"""Reads the body file of an import: checks it as XML, finds its meshes, and makes a URDF ready for MuJoCo."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from xml.etree import ElementTree

from retarget.errors import InputError, Problem
from retarget.model.body_xml import MAX_BYTES, body_xml, read_body
from retarget.schema import strict_models


@dataclass(frozen=True, eq=False)
class Source:
    """A body file. kind: urdf or mjcf; root: its outermost element; included: whether it names other MJCF files."""

    path: Path
    kind: str
    content: bytes
    root: ElementTree.Element
    included: bool

    @property
    def name(self) -> str:
        """What the file calls its robot, else its own name."""
        return (self.root.get("name") or self.root.get("model") or self.path.stem).strip() or self.path.stem


def read_source(path: Path) -> Source:
    """Read a body file, and look at every file that it includes. Raises InputError."""
    content = read_body(path)
    xml = body_xml(content, source=str(path), folder=path.parent)
    return Source(path, xml.kind, content, xml.root, xml.included)


# The files of meshes that a URDF names: where they are, and what of them MuJoCo reads.

READABLE = (".stl", ".obj", ".msh")
"""Meshes that MuJoCo reads."""
PACKAGE_DEPTH = 6
"""Folders above the body in which its package may be."""


def find_mesh(name: str, body: Path) -> Path | None:
    """The mesh of a name: relative to the body file, or in a folder above it that holds the package's path.

    None: there is no such file of a kind that can be read.
    """
    plain = name.removeprefix("file://")
    parts = Path(name.split("://", 1)[1]).parts if name.startswith(("package://", "model://")) else None
    places = [body.parent / plain]
    if parts is not None:
        above = body.absolute().parents[:PACKAGE_DEPTH]
        places = [folder.joinpath(*rest) for folder in above for rest in (parts, parts[1:])]
    for place in places:
        try:
            if place.suffix.lower() in READABLE and place.is_file() and 0 < place.stat().st_size <= MAX_BYTES:
                return place
        except (OSError, ValueError):
            continue
    return None


# A URDF made ready for import: joints that no servo turns, links without mass, meshes that are found or missing.

TURNS = ("revolute", "continuous")
KNOWN = (*TURNS, "fixed", "prismatic", "floating", "planar")
DROPPED = "collision meshes that cannot be read are left out, these links have other shapes"
SHAPES = ("collision", "visual")
INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def ready_urdf(source: Source, notes: list[str], *, no_meshes: bool) -> tuple[str, dict[str, bytes]]:
    """The URDF that is imported, and its meshes by the names that it has for them. What was changed becomes a note.
    no_meshes: leave out meshes that cannot be read.

    Raises InputError with all of its problems.
    """
    root, contents = copy.deepcopy(source.root), dict[str, bytes]()
    problems = [
        *_joints(root, source, notes),
        *_masses(root, source, notes),
        *_meshes(root, source, contents, notes, no_meshes=no_meshes),
    ]
    if problems:
        raise InputError.from_problems(problems, title=f"{source.path}: {len(problems)} problems")
    return ElementTree.tostring(root, encoding="unicode"), contents


def stated_speeds(source: Source) -> dict[str, float]:
    """Joint -> rad/s, as far as the file says it."""
    speeds = {}
    for joint in source.root.iter("joint"):
        limit = joint.find("limit")
        speed = 0.0 if limit is None else _number(limit.get("velocity"))
        if 0.0 < speed < 1e3:
            speeds[joint.get("name", "")] = speed
    return speeds


def _joints(root: ElementTree.Element, source: Source, notes: list[str]) -> Iterator[Problem]:
    """Make rigid what no servo of its own drives."""
    found: dict[str, list[str]] = {}
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
    notes += [f"{kind} joints, which no servo drives, made rigid: {listed(names)}" for kind, names in found.items()]


def _masses(root: ElementTree.Element, source: Source, notes: list[str]) -> Iterator[Problem]:
    """Problems of <inertial> with parts that are missing or no numbers, each once with all its links, and of a robot
    without any mass, which cannot be balanced; a note for links with a shape and no mass."""
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
    root: ElementTree.Element, source: Source, contents: dict[str, bytes], notes: list[str], *, no_meshes: bool
) -> Iterator[Problem]:
    """Read the meshes into `contents`, by new names, and remove the shapes that cannot be read. They are a problem for
    links without another shape; of other links, only collision shapes are noted: a visual shape more or less changes
    nothing."""
    missing, dropped = dict[str, None](), list[str]()
    for link in root.findall("link"):
        unread = []
        for shape, mesh in _mesh_shapes(link):
            file = find_mesh(name := mesh.get("filename", ""), source.path)
            if file is None:
                unread.append((shape, name))
                continue
            key = f"mesh_{len(contents)}{file.suffix.lower()}"
            contents[key] = file.read_bytes()
            mesh.set("filename", key)
        alone = len(unread) == sum(len(link.findall(kind)) for kind in SHAPES)
        for shape, name in unread:
            link.remove(shape)
            if alone:
                missing[name] = None
            elif shape.tag == "collision":
                dropped.append(f"{link.get('name', 'without a name')} ({name})")
    if missing and not no_meshes:
        yield Problem(
            "meshes that cannot be read, without which soles and hands cannot be found",
            str(source.path),
            listed(list(missing)),
            f"files {', '.join(READABLE)}, in the folder of the URDF, or in its package above it",
            "Put them there, or give --no-meshes to leave them out. Others (.dae, .stl as text): convert them to "
            "binary .stl (Blender, MeshLab, or trimesh: see docs/own-robot.md)",
        )
    left_out = f"{len(missing)} meshes that cannot be read are left out"
    for note, names in ((left_out, list(missing)), (DROPPED, dropped)):
        notes += [f"{note}: {listed(names)}"] if names else []


def _mesh_shapes(link: ElementTree.Element) -> list[tuple[ElementTree.Element, ElementTree.Element]]:
    """The shapes of a link that are meshes, each with its <mesh>."""
    shapes = [shape for kind in SHAPES for shape in link.findall(kind)]
    return [(shape, mesh) for shape in shapes if (mesh := shape.find("geometry/mesh")) is not None]


def listed(names: list[str]) -> str:
    """The first names, and how many more there are."""
    return strict_models.listed((name if len(name) <= 60 else f"...{name[-57:]}" for name in names), limit=8)
