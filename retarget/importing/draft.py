"""A drafted profile as data: everything that `robot.yaml` will say, before it is text."""

from dataclasses import dataclass, field

from retarget.importing.landmarks_found import LandmarkDraft
from retarget.importing.servo_guess import ServoDraft

__all__ = ["Draft", "FootDraft", "FrameDraft"]


@dataclass(frozen=True)
class FrameDraft:
    """As `profile_parts.Frame`, and what it is."""

    name: str
    link: str
    pos: tuple[float, ...]
    quat: tuple[float, ...]
    about: str


@dataclass(frozen=True)
class FootDraft:
    """As `profile_parts.Foot`."""

    side: str
    frame: str
    polygon: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Draft:
    """source: name of the file that it is made from. postures: name -> joint -> rad. facing: what told front from
    back. missing: what could not be found; notes: what was changed or assumed. observers: their sections as text."""

    name: str
    source: str
    body: str
    root: str
    frames: tuple[FrameDraft, ...]
    servos: tuple[ServoDraft, ...]
    feet: tuple[FootDraft, ...]
    postures: dict[str, dict[str, float]]
    landmarks: tuple[LandmarkDraft, ...]
    facing: str
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    observers: str = field(default="observers: {}\nignore_pairs: []\n")
