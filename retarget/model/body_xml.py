"""XML of MJCF and URDF, checked before MuJoCo reads it: no entities, bounded depth and number of elements, and no few
bytes that take all memory."""

import re
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from retarget.errors import InputError, Problem

MAX_BYTES = 64 * 1024 * 1024
"""Size of a body file, bytes."""
MAX_LINKS = 500
"""Links of a body. Humanoids have less than 100; a chain of 3,000 takes minutes to compile."""
MAX_DEPTH = 100
"""Depth of elements; more overflows the stack of parsers."""
MAX_ELEMENTS = 500_000
"""Elements of a file and its includes: a hundred times those of a large robot."""
MAX_REPLICATED = 5000
"""Elements made by <replicate>: those of a large robot. Their time is quadratic, 0.9 s for this number."""
MAX_DOUBLED = 8
"""Copies by <replicate> of a body with a sensor of no object, such as <clock/>: MuJoCo doubles these with each copy."""
NO_OBJECT = ("clock", "e_potential", "e_kinetic", "user", "contact")
"""Sensors that need no object."""
OBJECTS = frozenset(("objname", "site", "body1", "body2", "geom1", "geom2", "subtree1", "subtree2"))
"""Attributes that give sensors an object."""
MAX_INCLUDES = 50
"""Number of included files."""
KINDS = {"robot": "urdf", "mujoco": "mjcf", "mujocoinclude": "mjcf"}

BODY_HELP = "Give an MJCF (<mujoco>) or URDF (<robot>) file that MuJoCo can compile"
XACRO = "of a .xacro file, first make URDF: xacro robot.xacro > robot.urdf"

USERS = ("body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor")
SIZES: dict[str, dict[str, float]] = {
    "size": {
        **dict.fromkeys((f"nuser_{kind}" for kind in USERS), 100),
        "nkey": 1000,
        "nuserdata": 100_000,
        "njmax": 100_000,
        "nconmax": 100_000,
        "nstack": 10_000_000,
        "memory": 500e6,
    },
    "hfield": {"nrow": 1000, "ncol": 1000},
    "texture": {"width": 4096, "height": 3 * 4096},
    "mesh": {"params": 100},
    "user": {"dim": 1000},
    "contact": {"num": 1000},
    "": {"actdim": 1000, "nsample": 10_000},
}
"""Bounds of numbers in attributes by element; "": of any element. MuJoCo makes tables, pictures and meshes of these
sizes, some 10 MB each. memory: bytes."""
PRODUCTS: dict[str, dict[str, float]] = {
    "composite": {"count": MAX_LINKS},
    "flexcomp": {"count": MAX_LINKS, "cellcount": MAX_LINKS},
    "camera": {"resolution": 4e6},
}
"""Bounds of products of numbers: bodies of a composite or flexcomp, pixels of a camera."""
_BYTES = re.compile(r"\s*(-?\d+)\s*([KMGTPE]?)\s*")
_UNITS = {letter: float(1 << 10 * power) for power, letter in enumerate(("", *"KMGTPE"))}
"""Bytes by the letter after a number in `memory`."""


@dataclass(frozen=True)
class BodyXml:
    """A body file as elements. kind: urdf or mjcf."""

    root: Element
    kind: str


def read_body(path: Path) -> bytes:
    """The content of a body file. Raises InputError unless it is a regular file of a usable size."""
    try:
        if path.exists() and not path.is_file():
            found = "a folder" if path.is_dir() else "not a regular file"
            raise InputError("cannot read the body", where=str(path), found=found, next_step=BODY_HELP)
        size = path.stat().st_size
        if not 0 < size <= MAX_BYTES:
            allowed = f"1 to {MAX_BYTES} bytes"
            raise InputError("cannot read the body", where=str(path), found=f"{size} bytes", allowed=allowed)
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: an impossible path
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError("cannot read the body", where=str(path)[:200], found=reason, next_step=BODY_HELP) from error


def body_xml(content: bytes, *, source: str, folder: Path) -> BodyXml:
    """Read the elements of a body file, and check all files that it includes. folder: of the file.

    Raises InputError, with lines, for XML that cannot be read, no body, too many elements, or sizes too large.
    """
    counts = _Counts()
    root = _elements(content, source, counts, times=1)
    kind = KINDS.get(root.tag)
    if kind is None:
        found = f"the outermost element is <{root.tag[:80]}>"
        raise InputError("neither URDF nor MJCF", where=source, found=found, next_step=BODY_HELP)
    seen: set[Path] = set()
    for include in counts.includes:  # this list grows in the loop
        path = next((place for place in (include.folder(folder) / include.name, folder / include.name)
                     if place.exists()), folder / include.name)  # fmt: skip
        if path in seen or len(seen) >= MAX_INCLUDES:
            allowed = f"{MAX_INCLUDES} files, each once"
            raise InputError("includes that never end", where=include.source, found=include.name[:200], allowed=allowed)
        seen.add(path)
        _elements(read_body(path), str(path), counts, times=include.times)
    if counts.copies > MAX_DOUBLED:
        counts.problems += counts.doubled
    if counts.problems:
        raise InputError.from_problems(counts.problems, title=f"{source}: {len(counts.problems)} problems")
    if counts.links > MAX_LINKS:
        raise InputError(
            "too many links for a robot",
            where=source,
            found=str(counts.links),
            allowed=f"at most {MAX_LINKS}",
            next_step="Give the body of one robot, without its scene",
        )
    return BodyXml(root, kind)


@dataclass(frozen=True)
class _Include:
    """An included MJCF file. source: the file that includes it; times: by <replicate>."""

    name: str
    source: str
    times: int

    def folder(self, main: Path) -> Path:
        """Folder of the file that includes it; main: that of the body."""
        return Path(self.source).parent if Path(self.source).is_file() else main


@dataclass
class _Counts:
    elements: int = 0
    links: int = 0
    replicated: int = 0
    copies: int = 0
    doubled: list[Problem] = field(default_factory=list)
    """Sensors that MuJoCo doubles with each copy."""
    includes: list[_Include] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)

    def add(self, tag: str, attributes: dict[str, str], *, inside: str, times: int, place: tuple[str, int]) -> None:
        """Count an element that is repeated, inside of another. place: its file and line."""
        source, line = place
        self.problems += _size_problems(tag, attributes, source, line)
        self.links += times * (tag in ("link", "body"))
        before, self.replicated = self.replicated, self.replicated + times * (times > 1)
        if before <= MAX_REPLICATED < self.replicated:
            self.problems.append(_too_much("<replicate> makes too many elements", source, line, MAX_REPLICATED))
        if tag == "replicate":
            self.copies += times * _count(attributes)
        if inside == "sensor" and tag in NO_OBJECT and not OBJECTS & attributes.keys():
            what = f"MuJoCo doubles <{tag}>, a sensor without an object, with each copy that <replicate> makes"
            self.doubled.append(_too_much(what, source, line, MAX_DOUBLED))
        if tag == "include":
            self.includes.append(_Include(attributes.get("file", ""), source, times))


class _RefusedXmlError(Exception):
    """Problems of XML that no robot has."""


def _elements(content: bytes, source: str, counts: _Counts, *, times: int) -> Element:
    """The outermost element. times: number of includes of the file."""
    builder, parser = TreeBuilder(), expat.ParserCreate(namespace_separator="}")
    repeats, outer = [times], [""]

    def refuse_types(*_: object) -> None:
        raise _RefusedXmlError("a document type (<!DOCTYPE ...>), which may define entities, and which no robot needs")

    def start(name: str, attributes: dict[str, str]) -> None:
        space, _, tag = name.rpartition("}")
        if "xacro" in space:
            raise InputError(
                "xacro, from which the URDF has yet to be made",
                where=source,
                found=f"<xacro:{tag[:80]}>",
                next_step=f"Give the URDF; {XACRO}",
            )
        line, here = parser.CurrentLineNumber, repeats[-1]
        counts.elements += 1
        if len(repeats) > MAX_DEPTH or counts.elements > MAX_ELEMENTS:
            deep = len(repeats) > MAX_DEPTH
            raise _RefusedXmlError(
                f"elements more than {MAX_DEPTH} deep" if deep else f"more than {MAX_ELEMENTS} elements"
            )
        counts.add(tag, attributes, inside=outer[-1], times=here, place=(source, line))
        repeats.append(here * _count(attributes) if tag == "replicate" else here)
        outer.append(tag)
        builder.start(tag, attributes)

    def end(name: str) -> None:
        repeats.pop()
        outer.pop()
        builder.end(name.rpartition("}")[2])

    parser.StartDoctypeDeclHandler = refuse_types
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(content, True)
        return builder.close()
    except _RefusedXmlError as error:
        raise InputError("not a usable body", where=source, found=str(error)) from error
    except (expat.ExpatError, ValueError, LookupError) as error:
        step = f"Correct the XML; {XACRO}"
        raise InputError("not XML that can be read", where=source, found=str(error), next_step=step) from error


def _count(attributes: dict[str, str]) -> int:
    """Number of copies by <replicate>; too many if it is no number."""
    try:
        return max(int(attributes.get("count", "1")), 1)  # MuJoCo refuses less later
    except ValueError:
        return MAX_REPLICATED + 1


def _size_problems(tag: str, attributes: dict[str, str], source: str, line: int) -> list[Problem]:
    most = {**SIZES[""], **SIZES.get(tag, {}), **PRODUCTS.get(tag, {})}
    problems = []
    for name in filter(most.__contains__, attributes):
        text, allowed = attributes[name], most[name]
        if name == "memory":
            found = _BYTES.fullmatch(text)
            values = [float("inf") if found is None else int(found[1]) * _UNITS[found[2]]]
        else:
            values = _numbers(text)
        size = prod(map(abs, values)) if name in PRODUCTS.get(tag, {}) else max(values, default=0.0)
        if not size <= allowed:
            problems.append(_too_much(f"{name} of <{tag}> is too large", source, line, allowed, found=text))
    return problems


def _numbers(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return [float("inf")]


def _too_much(what: str, source: str, line: int, most: float, *, found: str = "") -> Problem:
    return Problem(
        what,
        f"{source}:{line}",
        found[:80] and repr(found[:80]),
        f"at most {most:.12g}",
        "A robot needs no more: make it smaller, or remove it",
        line,
    )
