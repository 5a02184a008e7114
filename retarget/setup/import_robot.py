"""Imports a body file: a folder with a drafted profile and the body, written whole or not at all."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from retarget.errors import ConfigError, InputError, UsageError
from retarget.ik.support_polygon import check_stand
from retarget.model.body import body_from_file
from retarget.model.body_file import BodyFile, compile_body
from retarget.model.robot import load_uncalibrated
from retarget.run.rest_trajectory import at_rest
from retarget.schema.catalogue import Kind, entries
from retarget.schema.files import check_folder, check_path
from retarget.schema.profile import marked_lines
from retarget.setup.body_draft import BodyDraft, draft_body, facing_x
from retarget.setup.draft import NO_OBSERVERS, Draft, find_landmarks, observer_text, profile_text
from retarget.setup.fit_observers import Subject, fit
from retarget.setup.frames import Found, Posed, find_frames
from retarget.setup.limbs import Anatomy, find_anatomy
from retarget.setup.postures import SPREADS, Postures, clear_postures, find_postures
from retarget.setup.robot_file import read_source, stated_speeds
from retarget.setup.servo_guess import guess_servos
from retarget.setup.shape_fit import Zones
from retarget.setup.tree import read_tree

DEFAULT_SAMPLES = 2000
ZONES = Zones(influence=0.04, margin=0.005)
OPTION = "--out"
FACING = 0.999
"""Least x of the direction in which a body faces that is written as it is."""
THICK = 1.6
"""A capsule of so many times the volume of its link gives way to a box: a draft had better not be in its own way."""
ROUNDS = 2
"""Links that touch in a posture are looked at again, without capsules."""


@dataclass(frozen=True)
class Imported:
    """The folder that was written, and what is in its profile.

    problems: what keeps it from being used, as `retarget check` says it; empty: it can be run. margin: how far (m) the
    centre of mass is inside the soles, None without soles or with problems. rest: how it is at rest, in words. drafts:
    lines that are marked so.
    """

    folder: Path
    draft: Draft
    problems: tuple[str, ...]
    margin: float | None
    rest: str
    drafts: int


def import_robot(
    path: Path,
    out: Path | None = None,
    *,
    no_meshes: bool = False,
    name: str | None = None,
    samples: int = DEFAULT_SAMPLES,
    progress: Callable[[float], None] = lambda share: None,
) -> Imported:
    """Draft a profile of a body file into the new folder `out`; None: named for the robot, here.

    no_meshes: leave out meshes that cannot be read. Raises InputError, UsageError, and leaves nothing behind.
    """
    if out is not None:
        _check_out(out)
    source = read_source(path)
    robot = _plain(name or source.name)
    if out is None:
        out = Path(robot)
        _check_out(out)
    body = draft_body(source, no_meshes=no_meshes)
    body = replace(body, notes=(*_taken(robot), *body.notes))
    speeds = stated_speeds(source) if source.kind == "urdf" else {}
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=out.parent, prefix=f".{out.name[:50]}.") as place:
            folder = Path(place) / "robot"
            folder.mkdir()
            draft = _drafted(folder, robot, path.name, body, speeds, samples=samples, progress=progress)
            problems, margin, rest = _checked(folder)
            _check_out(out)
            folder.rename(out)
    except OSError as error:
        raise UsageError("cannot write here", where=OPTION, found=f"{out}: {error.strerror}") from error
    return Imported(out, draft, problems, margin, rest, len(marked_lines(profile_text(draft))))


def _plain(name: str) -> str:
    """A name that a profile and a folder can bear."""
    return re.sub(r"[\s/\\]+", "_", name.strip())[:80].strip(".") or "robot"


def _taken(name: str) -> tuple[str, ...]:
    """A note where a robot of that name is known already: calibrations go by names."""
    if name not in {entry.name for entry in entries(Kind.ROBOT)}:
        return ()
    note = f"a robot {name} is known already: --robot {name} means that one, and both would share a calibration"
    return (f"{note}; give this one another --name",)


def _checked(folder: Path) -> tuple[tuple[str, ...], float | None, str]:
    """What `retarget check` would say, without the folder's passing name; how safely it stands; how it is at rest."""
    try:
        robot = load_uncalibrated(folder)
        return (), check_stand(robot), at_rest(robot)
    except ConfigError as error:
        texts = (replace(problem, where=problem.where.replace(f"{folder}/", "")).render() for problem in error.problems)
        return tuple(text.replace(f"{folder}/", "") for text in texts), None, ""


def _check_out(out: Path) -> None:
    check_path(out, option=OPTION)
    if out.exists() or out.is_symlink():
        step = "Give a folder that is not there yet; nothing is overwritten"
        raise UsageError("this is there already", where=OPTION, found=str(out), next_step=step)
    check_folder(out, option=OPTION)


def _drafted(
    folder: Path,
    name: str,
    source: str,
    body: BodyDraft,
    speeds: dict[str, float],
    *,
    samples: int,
    progress: Callable[[float], None],
) -> Draft:
    """Write body and profile into the folder."""
    tree = read_tree(body.model, source=source)
    anatomy = find_anatomy(tree)
    if anatomy.forward[0] < FACING:
        body = facing_x(body, anatomy.forward)
        tree = read_tree(body.model)
        anatomy = replace(find_anatomy(tree), facing=anatomy.facing)
    found = find_frames(tree, anatomy)
    servos = guess_servos(body.model, tree, anatomy, speeds)
    limits = {servo.joint: servo.entry.limits for servo in servos}
    posed = Posed(body.model, tree, anatomy, found, limits)
    (folder / body.file).write_bytes(body.content)
    notes = [*body.notes, *anatomy.named[:10]]
    file = _as_it_stands(folder / body.file, anatomy, found, notes)
    soles = file.root == "free"
    if anatomy.odd:
        notes.append(f"joints without a counterpart on the other side: {', '.join(anatomy.odd[:10])}")
    postures, observers = find_postures(posed, spread=SPREADS[0], soles=soles), NO_OBSERVERS
    if body.model.ngeom:
        subject = Subject(name, file, limits, postures.angles["neutral"], ())
        postures, observers = _observed(subject, posed, postures, soles=soles, samples=samples, progress=progress)
    else:
        notes.append("no link has a shape, so there are no observers, and nothing keeps the robot off itself")
    if soles and not postures.stands:
        notes.append("no posture was found in which it stands with flat soles: correct `postures`")
    draft = Draft(
        name=name,
        source=source,
        body=body.file,
        root=file.root,
        frames=posed.entries(),
        servos=servos,
        feet=found.feet if soles else {},
        postures=postures.angles,
        landmarks=find_landmarks(posed, postures.angles["stand"]),
        facing=anatomy.facing,
        missing=found.missing,
        notes=tuple(notes),
        observers=observers,
    )
    (folder / "robot.yaml").write_text(profile_text(draft), encoding="utf-8")
    return draft


def _observed(
    subject: Subject,
    posed: Posed,
    first: Postures,
    *,
    soles: bool,
    samples: int,
    progress: Callable[[float], None],
) -> tuple[Postures, str]:
    """Postures in which the fitted observers do not touch, and these as text."""
    body, tight = body_from_file(subject.file), frozenset[str]()
    for _ in range(ROUNDS):
        fitted = fit(subject, ZONES, samples=samples, thickest=THICK, tight=tight, progress=progress)
        postures, touching = clear_postures(body, fitted, posed, first, soles=soles)
        links = frozenset(link for pair in touching for link in pair)
        if links <= tight:
            break
        tight |= links
    return postures, observer_text(fitted, touching)


def _as_it_stands(body: Path, anatomy: Anatomy, found: Found, notes: list[str]) -> BodyFile:
    """The compiled body: free on two soles, if it can be set free; suspended on legs without soles, else fixed."""
    if found.feet:
        try:
            return compile_body(body, root="free")
        except InputError as error:
            notes.append(f"the body cannot be set free: {error.problems[0].what}, {error.problems[0].found}")
    return compile_body(body, root="suspended" if anatomy.legs else "fixed")
