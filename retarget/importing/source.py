"""The body file that is imported: looked at as XML before anything else reads it; refused where it is of no use."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

from retarget.body_file import MAX_BYTES
from retarget.errors import InputError

__all__ = ["Source", "read_source"]

MAX_DEPTH = 100
"""Elements inside each other: more overflows the stack of parsers."""
MAX_ELEMENTS = 500_000
MAX_INCLUDES = 50
KINDS = {"robot": "urdf", "mujoco": "mjcf", "mujocoinclude": "mjcf"}
XACRO = "of a .xacro file, first make URDF: xacro robot.xacro > robot.urdf"
HELP = "Give a URDF (<robot>) or MJCF (<mujoco>) file"


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
    content = _content(path)
    kind = KINDS.get(_scanned(path, content))
    if kind is None:
        tag = _scanned(path, content)
        raise InputError(
            "neither URDF nor MJCF", where=str(path), found=f"the outermost element is <{tag[:80]}>", next_step=HELP
        )
    root = _tree(path, content)
    return Source(path, kind, content, root, _look_at_includes(path, root, []))


def _content(path: Path) -> bytes:
    """Raises InputError for what is no regular file of a usable size."""
    try:
        if path.exists() and not path.is_file():
            found = "a folder" if path.is_dir() else "not a regular file"
            raise InputError("cannot read the body", where=str(path), found=found, next_step=HELP)
        size = path.stat().st_size
        if not 0 < size <= MAX_BYTES:
            raise InputError(
                "cannot read the body", where=str(path), found=f"{size} bytes", allowed=f"1 to {MAX_BYTES} bytes"
            )
        return path.read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError("cannot read the body", where=str(path)[:200], found=reason, next_step=HELP) from error


def _scanned(path: Path, content: bytes) -> str:
    """The outermost tag of sound and harmless XML. Raises InputError."""
    parser: Any = expat.ParserCreate()
    depth, count, outermost = 0, 0, ""

    def start(tag: str, _: dict[str, str]) -> None:
        nonlocal depth, count, outermost
        depth, count, outermost = depth + 1, count + 1, outermost or tag
        if depth > MAX_DEPTH or count > MAX_ELEMENTS:
            what = f"elements more than {MAX_DEPTH} deep" if depth > MAX_DEPTH else f"more than {MAX_ELEMENTS} elements"
            raise InputError("not a usable body", where=f"{path}:{parser.CurrentLineNumber}", found=what)

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    def doctype(*_: object) -> None:
        raise InputError(
            "not a usable body",
            where=f"{path}:{parser.CurrentLineNumber}",
            found="a document type, which may define entities",
            next_step="Remove <!DOCTYPE ...>: neither URDF nor MJCF needs it",
        )

    parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = start, end, doctype
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, UnicodeDecodeError, LookupError) as error:
        raise _unreadable(path, error) from error
    return outermost


def _tree(path: Path, content: bytes) -> ElementTree.Element:
    """The elements of XML that was scanned. Raises InputError for prefixes that mean nothing, and for xacro."""
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise _unreadable(path, error) from error
    for element in root.iter():
        space, _, tag = str(element.tag).rpartition("}")
        if "xacro" in space:
            raise InputError(
                "xacro, from which the URDF has yet to be made",
                where=str(path),
                found=f"<xacro:{tag[:80]}>",
                next_step=f"Give the URDF; {XACRO}",
            )
    return root


def _unreadable(path: Path, error: Exception) -> InputError:
    step = f"Mend the XML; {XACRO}"
    return InputError("not XML that can be read", where=str(path), found=str(error), next_step=step)


def _look_at_includes(path: Path, root: ElementTree.Element, seen: list[Path]) -> bool:
    """Scan every file that an MJCF includes, and those that these include. Raises InputError."""
    names = [element.get("file", "") for element in root.iter("include")]
    for name in names:
        other = path.parent / name
        if len(seen) >= MAX_INCLUDES or other in seen:
            raise InputError(
                "includes that never end", where=str(path), found=name[:200], allowed=f"{MAX_INCLUDES} files, each once"
            )
        seen.append(other)
        content = _content(other)
        _scanned(other, content)
        _look_at_includes(path, _tree(other, content), seen)
    return bool(names)
