"""Configurations by name or path: shipped ones in `configs/`, the user's own in `$XDG_CONFIG_HOME/retarget/`
(`~/.config/retarget/` by default), with the same folders inside.

A user's file hides the shipped one of the same name. Calibrations, of one specimen of a robot, are only the user's.
"""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from shlex import quote

from retarget.errors import ConfigError, UsageError, renamed_to, suggest
from retarget.schema.strict_models import listed
from retarget.schema.strict_yaml import Document, read_text, scan

MAX_LISTED = 1000  # configurations of one kind in one folder

BODIES = (".xml", ".mjcf", ".urdf")  # suffixes of bodies, which profiles name

MAX_SHOWN = 200  # characters of a user's path in a message


HUMAN = "human"
"""In place of a robot's name: only the performer is reconstructed."""


class Kind(StrEnum):
    """Kinds of configuration; the value is the folder's name."""

    ROBOT = "robots"
    PRIORITIES = "priorities"
    PERFORMER = "performers"
    SCENE = "scenes"
    SESSION = "sessions"

    @property
    def label(self) -> str:
        """Its name in a message."""
        return _LABELS[self]


_LABELS = {
    Kind.ROBOT: "robot",
    Kind.PRIORITIES: "priority file",
    Kind.PERFORMER: "performer",
    Kind.SCENE: "scene",
    Kind.SESSION: "session file",
}


@dataclass(frozen=True, slots=True)
class Entry:
    """A configuration. shipped: part of this package."""

    name: str
    path: Path
    shipped: bool


def shipped_folder() -> Path:
    """The folder `configs/` of the package."""
    return (Path(__file__).parent.parent / "configs").resolve()


def user_folder() -> Path:
    """The user's folder of configurations."""
    return _xdg_folder("XDG_CONFIG_HOME", ".config")


def cache_folder() -> Path:
    """The XDG cache folder."""
    return _xdg_folder("XDG_CACHE_HOME", ".cache")


def _xdg_folder(variable: str, usual: str) -> Path:
    """Our folder in one of XDG's, which requires that relative values are ignored."""
    base = Path(os.environ.get(variable, ""))
    if not base.is_absolute():
        base = Path(os.environ.get("HOME", "~")).expanduser() / usual
    return base / "retarget"


def calibration_path(robot: str) -> Path:
    """Path of the user's calibration of a robot, which may not exist."""
    return user_folder() / "calibrations" / f"{robot}.yaml"


def entries(kind: Kind) -> tuple[Entry, ...]:
    """All configurations of a kind by name; the user's hide shipped ones."""
    found = {entry.name: entry for entry in _in_folder(kind, shipped_folder(), shipped=True)}
    found |= {entry.name: entry for entry in _in_folder(kind, user_folder(), shipped=False)}
    return tuple(found[name] for name in sorted(found))


def find(kind: Kind, name_or_path: str | Path) -> Path:
    """The file of a configuration by name, or by path of the file or the robot's folder. Raises UsageError with the
    nearest names."""
    known = {entry.name: entry.path for entry in entries(kind)}
    if str(name_or_path) in known:
        return known[str(name_or_path)]
    path = Path(name_or_path)
    if kind is Kind.ROBOT and is_file(_inside(path)):
        return _inside(path)
    if is_file(path):
        if kind is Kind.ROBOT and path.suffix.lower() in BODIES:
            profile = _inside(path.parent)
            step = f"Give {profile}" if is_file(profile) else f"First: retarget import {quote(str(path))}"
            raise UsageError("this is a robot's body, not its profile", where=str(path)[:MAX_SHOWN], next_step=step)
        return path
    text = str(name_or_path)
    shown = text if len(text) <= MAX_SHOWN else text[:MAX_SHOWN] + "..."
    if "/" in text or os.sep in text or text.endswith((".yaml", ".yml")):
        raise UsageError(
            f"there is no such {kind.label}",
            where=shown,
            allowed=f"the path of a YAML file, or a name: {listed(known)}",
            next_step=renamed_to(Path(text).stem, known) or "Check the path",
        )
    also = {HUMAN: "which only reconstructs the performer"} if kind is Kind.ROBOT else {}
    raise UsageError(
        f"unknown {kind.label}",
        found=repr(shown),
        allowed=", or ".join([listed(known), *(f"{name}, {what}" for name, what in also.items())]),
        next_step=suggest(text, [*known, *also]) or f"Give one of these, or the path of a {kind.label}",
    )


def kind_of(path: Path) -> Kind | None:
    """The kind of a file by its folder, if known."""
    folders = [folder.name for folder in path.resolve().parents]
    return next((kind for kind in Kind if kind.value in folders[:3]), None)


OWN_KEYS = {
    Kind.ROBOT: {"body", "root", "frames", "servos", "buses", "feet", "postures", "landmarks", "safety"},
    Kind.PRIORITIES: {"extends", "levels", "iterations", "activation"},
    Kind.PERFORMER: {"sensors", "roles", "partial"},
    Kind.SCENE: {"obstacles"},
    Kind.SESSION: {"robot", "source", "bus"},
}
"""Keys that only files of one kind have."""


def kind_by_keys(keys: Iterable[str]) -> Kind | None:
    """The kind of a file by most of its keys, if known."""
    shared = {kind: len(own.intersection(keys)) for kind, own in OWN_KEYS.items()}
    best = max(shared, key=lambda kind: shared[kind])
    return best if shared[best] else None


def read_as(kind: Kind, name_or_path: str | Path) -> Document:
    """Strict YAML of a configuration by name or path. Raises UsageError as `find`, ConfigError for a file of another
    kind; the document holds its own problems."""
    path = find(kind, name_or_path)
    document = scan(read_text(path), path)
    other = kind_by_keys(document.data)
    if other is not None and other is not kind and not OWN_KEYS[kind].intersection(document.data):
        raise ConfigError(
            f"this is a {other.label}",
            where=str(path),
            found=f"keys {listed(document.data, limit=5)}",
            allowed=f"a {kind.label} ({', '.join(sorted(OWN_KEYS[kind]))})",
            next_step=f"Give a {kind.label}",
        )
    return document


def _in_folder(kind: Kind, folder: Path, *, shipped: bool) -> list[Entry]:
    try:
        items = sorted((folder / kind.value).iterdir())[:MAX_LISTED]
    except OSError:
        return []
    if kind is Kind.ROBOT:
        return [Entry(item.name, _inside(item), shipped) for item in items if _inside(item).is_file()]
    return [Entry(item.stem, item, shipped) for item in items if item.suffix == ".yaml" and item.is_file()]


def is_file(path: Path) -> bool:
    """True for a regular file; False for a path that the system cannot look up (too long, a zero byte)."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _inside(robot: Path) -> Path:
    return robot / "robot.yaml"
