"""A URDF made ready for import: joints that no servo turns, links without mass, meshes that are found or missing."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from xml.etree import ElementTree

from retarget.body_file import MAX_BYTES
from retarget.errors import InputError, Problem
from retarget.importing.source import Source

__all__ = ["ReadyUrdf", "Relaxed", "ready_urdf", "stated_speeds"]

TURNS = ("revolute", "continuous")
KNOWN = (*TURNS, "fixed", "prismatic", "floating", "planar")
INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
READABLE = (".stl", ".obj", ".msh")
"""Meshes that MuJoCo reads."""


@dataclass(frozen=True)
class Relaxed:
    """What the user lets go: joints that no servo turns are made rigid; meshes that cannot be read are left out."""

    freeze: bool = False
    no_meshes: bool = False


@dataclass(frozen=True, eq=False)
class ReadyUrdf:
    """text: URDF whose meshes are the keys of `meshes` (name -> content). changed: whether it differs from the file in
    more than their names. notes: what was changed."""

    text: str
    meshes: dict[str, bytes]
    changed: bool
    notes: tuple[str, ...]


def ready_urdf(source: Source, relaxed: Relaxed) -> ReadyUrdf:
    """The URDF that is imported. Raises InputError with all that is wrong with it."""
    root = copy.deepcopy(source.root)
    problems: list[Problem] = []
    notes: list[str] = []
    problems += _joints(root, source, relaxed, notes)
    problems += _masses(root, source, notes)
    meshes, missing, dropped = _meshes(root, source.path)
    if missing and not relaxed.no_meshes:
        problems.append(_missing_meshes(source, missing))
    elif missing:
        _drop(root, missing)
        notes.append(f"{len(missing)} meshes that cannot be read are left out: {_listed(missing)}")
    if dropped:
        notes.append(
            f"collision meshes that cannot be read are left out, these links have other shapes: {_listed(dropped)}"
        )
    if problems:
        raise InputError.from_problems(problems, title=f"{source.path}: {len(problems)} problems")
    text = ElementTree.tostring(root, encoding="unicode")
    return ReadyUrdf(text, meshes, bool(notes) or bool(meshes), tuple(notes))


def stated_speeds(source: Source) -> dict[str, float]:
    """Joint -> rad/s, as far as the file says it."""
    speeds = {}
    for joint in source.root.iter("joint"):
        limit = joint.find("limit")
        try:
            speed = float(limit.get("velocity", "nan")) if limit is not None else 0.0
        except ValueError:
            continue
        if 0.0 < speed < 1e3:
            speeds[joint.get("name", "")] = speed
    return speeds


def _joints(root: ElementTree.Element, source: Source, relaxed: Relaxed, notes: list[str]) -> Iterator[Problem]:
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
            if relaxed.freeze:
                joint.set("type", "fixed")
                for part in ("mimic", "limit", "axis", "dynamics", "safety_controller"):
                    for element in joint.findall(part):
                        joint.remove(element)
    for kind, names in found.items():
        if relaxed.freeze:
            notes.append(f"{kind} joints made rigid: {_listed(names)}")
        else:
            yield Problem(
                f"{kind} joints, which no servo of a profile drives",
                str(source.path),
                _listed(names),
                "joints of type revolute, continuous or fixed",
                "Make them fixed in the file, or give --freeze, which imports them as rigid",
            )


def _masses(root: ElementTree.Element, source: Source, notes: list[str]) -> Iterator[Problem]:
    """A robot without any mass cannot be balanced; a link without one is told, if it has a shape."""
    links = root.findall("link")
    yield from _unsound_inertias(links, source)
    masses = {link.get("name", ""): link.find("inertial/mass") for link in links}
    if links and not any(mass is not None and _positive(mass.get("value")) for mass in masses.values()):
        yield Problem(
            "no link has a mass, so nothing tells whether the robot stands",
            str(source.path),
            f"{len(links)} links without <inertial>, or with a mass of 0",
            next_step="Add <inertial> with mass, origin and inertia to every link that weighs something",
        )
        return
    bare = [
        link.get("name", "")
        for link in links
        if link.find("inertial") is None and any(link.find(kind) is not None for kind in ("collision", "visual"))
    ]
    if bare:
        notes.append(f"links with a shape but without <inertial> weigh nothing here: {_listed(bare)}")


def _unsound_inertias(links: list[ElementTree.Element], source: Source) -> Iterator[Problem]:
    """Parts of <inertial> that are missing or no numbers, each told once with its links."""
    found: dict[str, list[str]] = {}
    for link in links:
        inertial, name = link.find("inertial"), link.get("name", "without a name")
        if inertial is None:
            continue
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        if mass is None or not 0.0 <= _number(mass.get("value")) < float("inf"):
            found.setdefault("no <mass> of 0 kg or more", []).append(name)
        if inertia is None or not all(isfinite(_number(inertia.get(key, "0"))) for key in INERTIA):
            found.setdefault("no <inertia> of six numbers", []).append(name)
    for what, names in found.items():
        step = "Mend it, or remove <inertial>: then the link weighs nothing"
        yield Problem(f"links with an <inertial> that has {what}", str(source.path), _listed(names), "", step)


def _number(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return float("nan")


def _positive(text: str | None) -> bool:
    try:
        return float(text or "0") > 0.0
    except ValueError:
        return False


def _meshes(root: ElementTree.Element, path: Path) -> tuple[dict[str, bytes], list[str], list[str]]:
    """Meshes by new names, which the elements now bear; the names of those that cannot be read; and those shapes, told
    by link, that are dropped because they cannot be read and their links have others.

    A picture that cannot be read is no loss where the link has another shape: of that nothing is told.
    """
    contents: dict[str, bytes] = {}
    missing: list[str] = []
    dropped: list[str] = []
    for link in root.findall("link"):
        unread, usable = [], 0
        for shape in [shape for kind in ("collision", "visual") for shape in link.findall(kind)]:
            mesh = shape.find("geometry/mesh")
            file = None if mesh is None else _found(mesh.get("filename", ""), path)
            if mesh is not None and file is None:
                unread.append((shape, mesh.get("filename", "")))
                continue
            usable += 1
            if mesh is not None and file is not None:
                key = f"mesh_{len(contents)}{file.suffix.lower()}"
                contents[key] = file.read_bytes()
                mesh.set("filename", key)
        for shape, name in unread:
            if not usable:
                missing.append(name)
                continue
            link.remove(shape)
            if shape.tag == "collision":
                dropped.append(f"{link.get('name', 'without a name')} ({name})")
    return contents, list(dict.fromkeys(missing)), dropped


def _found(name: str, path: Path) -> Path | None:
    """The mesh of a name: beside the file, or in a folder above it that holds the package's path."""
    if Path(name).suffix.lower() not in READABLE:
        return None
    plain = name.removeprefix("file://")
    parts = Path(name.split("://", 1)[1]).parts if name.startswith(("package://", "model://")) else None
    places = [path.parent / plain]
    if parts is not None:
        above = path.absolute().parents[:6]
        places = [folder.joinpath(*rest) for folder in above for rest in (parts, parts[1:])]
    for place in places:
        try:
            if place.is_file() and 0 < place.stat().st_size <= MAX_BYTES:
                return place
        except (OSError, ValueError):
            continue
    return None


def _missing_meshes(source: Source, missing: list[str]) -> Problem:
    return Problem(
        "meshes that cannot be read, without which soles and hands cannot be found",
        str(source.path),
        _listed(missing),
        f"files {', '.join(READABLE)}, beside the URDF, or in its package above it",
        "Put them there (of .dae, convert to .stl), or give --no-meshes to leave them out",
    )


def _drop(root: ElementTree.Element, missing: list[str]) -> None:
    for link in root.findall("link"):
        for kind in ("collision", "visual"):
            for shape in link.findall(kind):
                mesh = shape.find("geometry/mesh")
                if mesh is not None and mesh.get("filename", "") in missing:
                    link.remove(shape)


def _listed(names: list[str]) -> str:
    shown = ", ".join(name if len(name) <= 60 else f"...{name[-57:]}" for name in names[:8])
    return shown + (f" and {len(names) - 8} more" if len(names) > 8 else "")
