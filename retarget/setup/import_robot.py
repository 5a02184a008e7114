"""Import of a body file into a folder with a drafted profile and the body, written whole or not at all."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from retarget.errors import InputError, RefusedError, UsageError
from retarget.ik.support_polygon import check_stand
from retarget.model.body import body_from_file
from retarget.model.body_file import Root, compile_body
from retarget.model.observers import robot_observers
from retarget.model.robot import load_uncalibrated
from retarget.run.options import RunOptions
from retarget.run.rest_trajectory import at_rest
from retarget.run.trial import try_approach, try_robot
from retarget.safety.joint_ranges import questioned_ranges
from retarget.schema.catalogue import Kind, entries
from retarget.schema.files import check_folder, refuse_existing
from retarget.schema.profile import marked_lines
from retarget.setup.body_draft import BodyDraft, draft_body, facing_x
from retarget.setup.draft import Draft, find_landmarks, profile_text
from retarget.setup.fit_observers import PlacedShapes, ignored_links
from retarget.setup.frames import FoundFrames, Posed, find_anatomy, find_frames
from retarget.setup.links import PartLinks, completed, propose_links
from retarget.setup.postures import find_postures
from retarget.setup.robot_file import Source, listed, read_source
from retarget.setup.servo_guess import guess_servos
from retarget.setup.tree import Tree, read_tree

OPTION = "--out"


@dataclass(frozen=True, eq=False)
class UnknownRobot:
    """A robot that is read but not yet imported. proposed: the links of its parts."""

    source: Source
    body: BodyDraft
    tree: Tree
    proposed: PartLinks


def read_robot(path: Path, *, no_meshes: bool = False) -> UnknownRobot:
    """Read a body, and propose the links of its parts. no_meshes: leave out unreadable meshes. Raises InputError."""
    source = read_source(path)
    body = draft_body(source, no_meshes=no_meshes)
    tree = read_tree(body.model, source=str(path))
    return UnknownRobot(source, body, tree, propose_links(tree, welded=body.welded))


@dataclass(frozen=True)
class Imported:
    """A written folder with its profile. problems: of `retarget check`; a run can begin if there are none. margin: of
    the centre of mass inside of the soles, m, None without soles or with problems. rest, wide: rest and questioned
    ranges in words. drafts: number of marked lines. again: True if the body file must be corrected first."""

    folder: Path
    draft: Draft
    problems: tuple[str, ...]
    margin: float | None
    rest: str
    wide: tuple[str, ...]
    drafts: int
    again: bool = False


def import_robot(
    robot: Path | UnknownRobot,
    out: Path | None = None,
    *,
    links: PartLinks | None = None,
    name: str | None = None,
    servo: str = "",
) -> Imported:
    """Draft a profile of a body into the new folder `out`, by default one with the robot's name.

    links: replace proposed ones. servo: model of all servos, "" to choose them by the file. Raises InputError,
    UsageError, ConfigError, HardwareError, and leaves no file behind then.
    """
    if out is not None:
        _check_out(out)
    if isinstance(robot, Path):
        robot = read_robot(robot)
    known = re.sub(r"[\s/\\]+", "_", (name or robot.source.name).strip())[:80].strip(".") or "robot"
    if out is None:
        out = Path(known)
        _check_out(out)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=out.parent, prefix=f".{out.name[:50]}.") as place:
            folder = Path(place) / "robot"
            folder.mkdir()
            draft = _drafted(folder, known, robot, links or PartLinks(), servo)
            too_large = robot.body.too_large
            problems, margin, rest, wide = ((too_large,), None, "", ()) if too_large else _checked(folder)
            _check_out(out)
            folder.rename(out)
    except OSError as error:
        raise UsageError("cannot write here", where=OPTION, found=f"{out}: {error.strerror}") from error
    drafts = len(marked_lines(profile_text(draft)))
    return Imported(out, draft, problems, margin, rest, wide, drafts, again=bool(too_large))


def _checked(folder: Path) -> tuple[tuple[str, ...], float | None, str, tuple[str, ...]]:
    """Return `problems`, `margin`, `rest` and `wide` of `Imported`, without the name of the temporary folder."""
    try:
        robot = load_uncalibrated(folder)
        margin, rest = check_stand(robot), at_rest(robot)
        try_robot(robot, RunOptions(robot=str(folder), bus="mock"))
        try_approach(robot)
        return (), margin, rest, tuple(questioned_ranges(robot, robot_observers(robot)))
    except RefusedError as error:
        texts = (replace(problem, where=problem.where.replace(f"{folder}/", "")).render() for problem in error.problems)
        return tuple(text.replace(f"{folder}/", "") for text in texts), None, "", ()


def _check_out(out: Path) -> None:
    refuse_existing(out, option=OPTION, step="Give a folder that is not there yet; nothing is overwritten")
    check_folder(out, option=OPTION)


def _drafted(folder: Path, name: str, robot: UnknownRobot, given: PartLinks, servo: str) -> Draft:
    body, tree = robot.body, robot.tree
    links = completed(robot.proposed, given, tree)
    anatomy = find_anatomy(tree, links)
    if anatomy.forward[0] < 1.0:
        body = facing_x(body, anatomy.forward)
        tree = read_tree(body.model)
        anatomy = find_anatomy(tree, links)
    found = find_frames(tree, anatomy)
    servos = guess_servos(body, tree, anatomy, model=servo)
    limits = {one.joint: one.entry.limits for one in servos}
    posed = Posed(body.model, tree, anatomy, found, limits)
    (folder / "body.xml").write_bytes(body.content)
    notes = [*filter(None, [body.too_large]), *body.notes]
    if name in {entry.name for entry in entries(Kind.ROBOT)}:
        note = f"a robot {name} is known already: --robot {name} means that one, and both would share a calibration"
        notes.insert(0, f"{note}; give this one another --name")
    changed = [f"{one.joint} ({one.note})" for one in servos if one.note and one.joint not in body.limits]
    if changed:
        notes.append(f"limits that are not those of the body: {listed(changed)}")
    limbs = ((links.l_elbow, links.l_hand), (links.r_elbow, links.r_hand))
    if both := [hand for elbow, hand in limbs if hand and elbow == hand]:
        notes.append(f"forearm and hand are one link ({', '.join(both)}): its end is the hand")
    root = _root(folder / "body.xml", found, has_legs=bool(anatomy.legs), notes=notes)
    file = compile_body(folder / "body.xml", root=root)
    placed, soles = PlacedShapes(body_from_file(file), body.shapes), root == "free"
    found_postures = find_postures(posed, soles=soles, touching=placed.touching)
    if soles and not all(posture.stands for posture in found_postures.values()):
        notes.append("no posture was found in which it stands with flat soles: correct `postures`")
    postures = {name: posture.angles for name, posture in found_postures.items()}
    others = {name: postures[name] for name in ("stand", "attractor")}
    landmarks, missing = find_landmarks(posed, postures["stand"])
    draft = Draft(
        name=name,
        source=robot.source.path.name,
        body="body.xml",
        root=root,
        frames=posed.entries(),
        servos=servos,
        feet=found.feet if soles else {},
        postures=postures,
        landmarks=landmarks,
        shapes=body.shapes,
        ignored=ignored_links(placed, postures["neutral"], others),
        links=links,
        missing=(*found.missing, *missing),
        notes=tuple(notes),
    )
    (folder / "robot.yaml").write_text(profile_text(draft), encoding="utf-8")
    return draft


def _root(body: Path, found: FoundFrames, *, has_legs: bool, notes: list[str]) -> Root:
    """The root: free on two soles if the body can be set free, suspended for legs without soles, else fixed."""
    if found.feet:
        try:
            compile_body(body, root="free")
            return "free"
        except InputError as error:
            notes.append(f"the body cannot be set free: {error.problems[0].what}, {error.problems[0].found}")
    return "suspended" if has_legs else "fixed"
