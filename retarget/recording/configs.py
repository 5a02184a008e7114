"""The config files of a recorded run, as they were then or as they are now: where they lie, or from the recording."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

from retarget.errors import InputError, RefusedError, UsageError
from retarget.model.robot import RobotBody, load_robot, robot_of
from retarget.recording.reading import Recording
from retarget.recording.session import config_content
from retarget.run.options import RunOptions, priority_names
from retarget.schema.catalogue import Kind, calibration_path, find
from retarget.schema.profile import RobotProfile, read_profile
from retarget.schema.servo_calibration import read_calibration

PROFILE, CALIBRATION, PERFORMER, SCENE = "robot.yaml", "calibration.yaml", "performer.yaml", "scene.yaml"
PRIORITIES_OF = "priorities_of_the_{}.yaml"
ANOTHER = "Say which robot is meant: --robot NAME|FILE"


@dataclass(frozen=True, eq=False)
class Configs:
    """What a recorded run is made of, to be run again.

    options: they name the files that are used. robot: None of a human alone. notes: which files differ from those of
    the recorded run, and which are used, a sentence each. attached: names of the files that were taken from the
    recording; they exist only while the context lasts.
    """

    options: RunOptions
    robot: RobotBody | None
    notes: tuple[str, ...]
    attached: frozenset[str] = frozenset()

    @property
    def body_attached(self) -> bool:
        """Whether the robot's body file was taken from the recording."""
        return any(name.startswith("body.") for name in self.attached)


@contextmanager
def as_recorded(recording: Recording, *, body: Path | None = None) -> Iterator[Configs]:
    """Every file as it was: from its place where it still is so, else from the recording, while the context lasts.

    body: the robot's body file instead of both. Raises RetargetError where a file is nowhere, or is none for this
    version.
    """
    with TemporaryDirectory(prefix="retarget.") as folder:
        files = _Files(recording, Path(folder), now=False)
        options = recording.session.options
        yield _configs(files, options, None if options.is_human else _robot_of_then(files, options, body))


@contextmanager
def as_now(recording: Recording, options: RunOptions, *, robot: str | None = None) -> Iterator[Configs]:
    """Every file as it is now; from the recording only what is not there any more. options: of the recording, or with
    another bus. robot: by name or path, instead of the one that they name. Raises RetargetError."""
    if robot is not None and options.is_human:
        raise UsageError("only a human was recorded", where="--robot", found=robot[:80], next_step="Leave it out")
    with TemporaryDirectory(prefix="retarget.") as folder:
        files = _Files(recording, Path(folder), now=True)
        if options.is_human:
            yield _configs(files, options, None)
        elif robot is None and _found(Kind.ROBOT, options.robot) is None:
            yield _configs(files, options, _robot_of_then(files, options, None))
        else:
            options = options if robot is None else replace(options, robot=robot)
            found = load_robot(options.robot, root=options.root)
            _note_robot(files, found)
            yield _configs(files, options, found)


@contextmanager
def recorded_scene(recording: Recording) -> Iterator[tuple[str | None, tuple[str, ...]]]:
    """The scene alone, as it was: its name or file (None without one), and notes on it. Raises RetargetError."""
    scene = recording.session.scene
    with TemporaryDirectory(prefix="retarget.") as folder:
        files = _Files(recording, Path(folder), now=False)
        found = None if scene is None else _named(files, SCENE, Kind.SCENE, scene)
        yield found, tuple(files.notes)


class _Files:
    """Finds each file of a run. now: as it is now, else as it was then. notes: which files differ from then."""

    def __init__(self, recording: Recording, folder: Path, *, now: bool) -> None:
        self.recording, self.notes, self.attached = recording, list[str](), set[str]()
        self._folder, self._now = folder, now
        self.said = {file.name: file for file in recording.session.files}
        """Entries of the recording, by name."""

    def place(self, name: str, now: Path | None) -> Path:
        """Of one file. Raises InputError where it is nowhere."""
        if now is not None and self._now:
            self.note_changed(name, now)
            return now
        if now is not None and self.is_as_then(name, now):
            return now
        then = Path(self.said[name].path) if name in self.said else None
        if then is None or self._now or not self.is_as_then(name, then):
            then = self._attached(name)
        elif now is None:
            return then  # somewhere else than where its name leads to, and as it was
        state = "is not there any more" if now is None else f"is another one now, {now}"
        self.notes.append(f"{name} {state}: the one of then is used")
        return then

    def note_changed(self, name: str, now: Path) -> None:
        """Note a file that is used as it is now, if it differs from that of then."""
        if name not in self.said:
            self.notes.append(f"{name}: there was none then: {now}")
        elif not self.is_as_then(name, now):
            self.notes.append(f"{name} has changed: {now}")

    def is_as_then(self, name: str, path: Path) -> bool:
        """Whether a file holds what it held."""
        said = self.said.get(name)
        try:
            return said is not None and hashlib.sha256(config_content(name, path)).hexdigest() == said.sha256
        except (RefusedError, OSError, ValueError):
            return False

    def _attached(self, name: str) -> Path:
        content = self.recording.attachments.get(name)
        if content is None or PurePosixPath(name).name != name:
            said, of_robot = self.said.get(name), name in (PROFILE, CALIBRATION) or name.startswith("body.")
            raise InputError(
                "a file of the recorded run is not there any more, and not in the recording",
                where=str(self.recording.path),
                found=f"no {name}" + (f", which was {said.path}" if said else ""),
                next_step="Put it back" + (f"; or {ANOTHER[0].lower()}{ANOTHER[1:]}" if of_robot else ""),
            )
        self.attached.add(name)
        path = self._folder / name
        path.write_bytes(content)
        return path


def _found(kind: Kind, name: str) -> Path | None:
    """Where a file that an option names is now."""
    try:
        return find(kind, name)
    except UsageError:
        return None


def _configs(files: _Files, options: RunOptions, robot: RobotBody | None) -> Configs:
    """The robot and all other files."""
    options = replace(options, performer=_named(files, PERFORMER, Kind.PERFORMER, options.performer))
    if options.scene is not None:
        options = replace(options, scene=_named(files, SCENE, Kind.SCENE, options.scene))
    names = priority_names(robot, options)
    chosen = [
        _named(files, PRIORITIES_OF.format(stage), Kind.PRIORITIES, name)
        for stage, name in zip(("human", "robot"), names, strict=False)
    ]
    if chosen[-1] != names[-1]:
        options = replace(options, priorities=chosen[-1])
    if robot is not None and chosen[0] != names[0]:
        robot = replace(robot, profile=robot.profile.model_copy(update={"reconstruct": chosen[0]}))
    return Configs(options, robot, tuple(files.notes), frozenset(files.attached))


def _named(files: _Files, name: str, kind: Kind, asked: str) -> str:
    """What the options name; a path where that does not lead to the file which is to be used."""
    now = _found(kind, asked)
    place = files.place(name, now)
    return asked if place == now else str(place)


def _robot_of_then(files: _Files, options: RunOptions, body: Path | None) -> RobotBody:
    found = _found(Kind.ROBOT, options.robot)
    path = files.place(PROFILE, found)
    try:
        profile = read_profile(path)
        if body is None:
            near = None if found is None else found.parent / profile.body
            name = next((name for name in files.said if name.startswith("body.")), "body.xml")
            body = files.place(name, near if near is not None and near.is_file() else None)
        profile = profile.model_copy(update={"body": str(body.resolve())})
        place = _calibration(files, profile)
        calibration = None if place is None else read_calibration(profile, place)
        return robot_of(profile, calibration, root=options.root)
    except RefusedError as error:
        first = replace(error.problems[0], next_step="").render().rstrip(".").replace(f"{path.parent}/", "")
        more = f", and {len(error.problems) - 1} more" if len(error.problems) > 1 else ""
        where = str(files.recording.path)
        raise InputError(
            "the robot of then cannot be used", where=where, found=first + more, next_step=ANOTHER
        ) from error


def _calibration(files: _Files, profile: RobotProfile) -> Path | None:
    """The calibration of then; None where there was none."""
    now = calibration_path(profile.name)
    there = now if now.is_file() else None
    if CALIBRATION in files.said:
        return files.place(CALIBRATION, there)
    if there is not None:
        files.notes.append(f"{CALIBRATION}: there was none then; {there} is not used")
    return None


def _note_robot(files: _Files, robot: RobotBody) -> None:
    """Note which files changed of a robot that is used as it is now."""
    profile = robot.profile
    files.note_changed(PROFILE, profile.path)
    files.note_changed(f"body{profile.body_path.suffix}", profile.body_path)
    if robot.calibration is not None:
        files.note_changed(CALIBRATION, calibration_path(profile.name))
    elif CALIBRATION in files.said:
        files.notes.append(f"{CALIBRATION}: there is none now")
