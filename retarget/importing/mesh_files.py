"""The files of meshes that a URDF names: where they are, and what of them MuJoCo reads."""

import struct
from dataclasses import dataclass
from pathlib import Path

from retarget.body_file import MAX_BYTES

__all__ = ["READABLE", "MeshFile", "find_mesh"]

READABLE = (".stl", ".obj", ".msh")
"""Meshes that MuJoCo reads."""
PACKAGE_DEPTH = 6
"""Folders above the body in which its package may be."""
STL_HEAD = 84
"""Bytes before the first triangle of a binary STL."""
STL_TRIANGLE = struct.Struct("<12fH")


@dataclass(frozen=True)
class MeshFile:
    """path: what is read. twin: it stands beside the file that was named, which is of a kind that is not read."""

    path: Path
    twin: bool

    def content(self) -> bytes:
        """As MuJoCo reads it: an STL of text becomes one of bytes. Raises OSError."""
        content = self.path.read_bytes()
        return _binary(content) if self.path.suffix.lower() == ".stl" else content


def find_mesh(name: str, body: Path) -> MeshFile | None:
    """The mesh of a name: beside the body file, or in a folder above it that holds the package's path.

    Of another kind (`.dae`): the mesh of the same name beside it that can be read. None: there is no such file.
    """
    plain = name.removeprefix("file://")
    parts = Path(name.split("://", 1)[1]).parts if name.startswith(("package://", "model://")) else None
    places = [body.parent / plain]
    if parts is not None:
        above = body.absolute().parents[:PACKAGE_DEPTH]
        places = [folder.joinpath(*rest) for folder in above for rest in (parts, parts[1:])]
    readable = Path(plain).suffix.lower() in READABLE
    for place in places:
        if not place.name:
            continue
        for one in (place,) if readable else tuple(place.with_suffix(kind) for kind in READABLE):
            try:
                if one.is_file() and 0 < one.stat().st_size <= MAX_BYTES:
                    return MeshFile(one, twin=not readable)
            except (OSError, ValueError):
                continue
    return None


def _binary(content: bytes) -> bytes:
    """An STL of text as one of bytes; what is none stays, and MuJoCo says what is wrong with it."""
    is_binary = len(content) >= STL_HEAD and len(content) == STL_HEAD + STL_TRIANGLE.size * _count(content)
    if is_binary or content.lstrip()[:5].lower() != b"solid":
        return content
    words = content.split()
    try:
        corners = [tuple(map(float, words[at + 1 : at + 4])) for at, word in enumerate(words) if word == b"vertex"]
        triangles = [corners[at : at + 3] for at in range(0, len(corners), 3)]
        rows = [STL_TRIANGLE.pack(0.0, 0.0, 0.0, *a, *b, *c, 0) for a, b, c in triangles]
    except (ValueError, struct.error):
        return content
    return bytes(STL_HEAD - 4) + struct.pack("<I", len(rows)) + b"".join(rows) if rows else content


def _count(content: bytes) -> int:
    """How many triangles a binary STL says that it has."""
    return int.from_bytes(content[STL_HEAD - 4 : STL_HEAD], "little")
