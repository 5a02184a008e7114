"""A URDF made ready for import: joints that no servo turns, links without mass, meshes that are found or missing."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from xml.etree import ElementTree

from retarget.errors import InputError, Problem
from retarget.importing.mesh_files import READABLE, find_mesh
from retarget.importing.source import Source

__all__ = ["ReadyUrdf", "Relaxed", "ready_urdf", "stated_speeds"]

TURNS = ("revolute", "continuous")
KNOWN = (*TURNS, "fixed", "prismatic", "floating", "planar")
DROPPED = "collision meshes that cannot be read are left out, these links have other shapes"
TWINS = "meshes of a kind that is not read were read from the file of the same name beside them"
INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


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
    meshes = _meshes(root, source.path)
    if meshes.missing and not relaxed.no_meshes:
        problems.append(_missing_meshes(source, meshes.missing))
    elif meshes.missing:
        _drop(root, meshes.missing)
        notes.append(f"{len(meshes.missing)} meshes that cannot be read are left out: {_listed(meshes.missing)}")
    for told, names in ((DROPPED, meshes.dropped), (TWINS, meshes.twins)):
        notes += [f"{told}: {_listed(names)}"] if names else []
    if problems:
        raise InputError.from_problems(problems, title=f"{source.path}: {len(problems)} problems")
    text = ElementTree.tostring(root, encoding="unicode")
    return ReadyUrdf(text, meshes.contents, bool(notes) or bool(meshes.contents), tuple(notes))


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


@dataclass(frozen=True, eq=False)
class _Meshes:
    """contents: by new names, which the elements now bear. missing: names of those that cannot be read. dropped:
    shapes, told by link, that cannot be read and whose links have others. twins: those read in the place of others."""

    contents: dict[str, bytes] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    dropped: list[str] = field(default_factory=list)
    twins: list[str] = field(default_factory=list)


def _meshes(root: ElementTree.Element, path: Path) -> _Meshes:
    """Find them. A picture that cannot be read is no loss where the link has another shape: of that nothing is told."""
    found = _Meshes()
    missing: dict[str, None] = {}
    for link in root.findall("link"):
        unread, usable = [], 0
        for shape in [shape for kind in ("collision", "visual") for shape in link.findall(kind)]:
            mesh = shape.find("geometry/mesh")
            name = "" if mesh is None else mesh.get("filename", "")
            file = None if mesh is None else find_mesh(name, path)
            if mesh is not None and file is None:
                unread.append((shape, name))
                continue
            usable += 1
            if mesh is not None and file is not None:
                key = f"mesh_{len(found.contents)}{file.path.suffix.lower()}"
                found.contents[key] = file.content()
                mesh.set("filename", key)
                if file.twin and file.path.name not in found.twins:
                    found.twins.append(file.path.name)
        for shape, name in unread:
            if not usable:
                missing[name] = None
                continue
            link.remove(shape)
            if shape.tag == "collision":
                found.dropped.append(f"{link.get('name', 'without a name')} ({name})")
    found.missing.extend(missing)
    return found


def _missing_meshes(source: Source, missing: list[str]) -> Problem:
    return Problem(
        "meshes that cannot be read, without which soles and hands cannot be found",
        str(source.path),
        _listed(missing),
        f"files {', '.join(READABLE)}, beside the URDF, or in its package above it",
        "Put them there, or give --no-meshes to leave them out. Others (.dae): convert them to .stl of the same name "
        "in the same folder (Blender, MeshLab, or trimesh: see docs/own-robot.md); the URDF may stay as it is",
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
