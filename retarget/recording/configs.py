"""The config files of a recorded run, from their place if unchanged, else from the recording."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

from retarget.errors import InputError, RefusedError, UsageError
from retarget.model.body_xml import MAX_BYTES
from retarget.model.robot import RobotBody, load_robot, robot_of
from retarget.recording.reading import Recording
from retarget.recording.session import config_content, config_files
from retarget.run.options import RunOptions
from retarget.schema.profile import read_profile
from retarget.schema.servo_calibration import read_calibration

PROFILE, CALIBRATION, PERFORMER, SCENE = "robot.yaml", "calibration.yaml", "performer.yaml", "scene.yaml"
PRIORITIES_OF = "priorities_of_the_{}.yaml"
ANOTHER = "Say which robot is meant: --robot NAME|FILE"


@dataclass(frozen=True, eq=False)
class Configs:
    """The configuration of a recorded run. robot: None for a human alone. notes: changed files, and those that are
    used, one sentence each. attached: files taken from the recording, which exist only in the context."""

    options: RunOptions
    robot: RobotBody | None
    notes: tuple[str, ...]
    attached: frozenset[str] = frozenset()

    @property
    def body_attached(self) -> bool:
        """True if the robot's body file was taken from the recording."""
        return any(name.startswith("body.") for name in self.attached)


@contextmanager
def as_recorded(
    recording: Recording, *, options: RunOptions | None = None, robot: str | None = None, body: Path | None = None
) -> Iterator[Configs]:
    """The configuration of a recording, in a context: unchanged files from their place, others from the recording.

    options: of the recording, or with another bus. robot: name or path of a present robot to use instead. body: the
    robot's body file to use instead. Raises RetargetError where a file is missing or invalid in this version.
    """
    options = recording.session.options if options is None else options
    if robot is not None and options.is_human:
        raise UsageError("only a human was recorded", where="--robot", found=robot[:80], next_step="Leave it out")
    with TemporaryDirectory(prefix="retarget.") as folder:
        files = _Files(recording, Path(folder))
        if robot is not None:
            options = replace(options, robot=robot)
            found: RobotBody | None = load_robot(robot, root=options.root)
        else:
            found = None if options.is_human else _recorded_robot(files, options, body)
        options = replace(options, performer=files.place(PERFORMER))
        if options.scene is not None:
            options = replace(options, scene=files.place(SCENE) if robot is None else files.present(SCENE))
        yield _with_priorities(files, options, found, present=robot is not None)


@contextmanager
def recorded_scene(recording: Recording) -> Iterator[tuple[str | None, tuple[str, ...]]]:
    """The scene as it was: its name or file (None without one), and notes on it. Raises RetargetError."""
    scene = recording.session.scene
    with TemporaryDirectory(prefix="retarget.") as folder:
        files = _Files(recording, Path(folder))
        yield None if scene is None else files.place(SCENE), tuple(files.notes)


class _Files:
    """Finds the files of a run. notes: changed files. recorded: entries of the recording."""

    def __init__(self, recording: Recording, folder: Path) -> None:
        self.recording, self.notes, self.attached = recording, list[str](), set[str]()
        self.recorded = {file.name: file for file in recording.session.files}
        self._folder = folder

    def place(self, name: str) -> str:
        """Path of a file as it was. Raises InputError where it is missing."""
        then = Path(self.recorded[name].path) if name in self.recorded else None
        if then is not None and self.unchanged(name, then):
            return str(then)
        content = self.recording.attachments.get(name)
        if content is None or PurePosixPath(name).name != name:
            of_robot = name in (PROFILE, CALIBRATION) or name.startswith("body.")
            raise InputError(
                "a file of the recorded run is missing, and not in the recording",
                where=str(self.recording.path),
                found=f"no {name}" + (f", which was {then}" if then else ""),
                next_step="Put it back" + (f"; or {ANOTHER[0].lower()}{ANOTHER[1:]}" if of_robot else ""),
            )
        if then is not None and then.exists():
            self.notes.append(f"{name} has changed since, {then}: the recorded one is used")
        self.attached.add(name)
        path = self._folder / name
        path.write_bytes(content)
        return str(path)

    def present(self, name: str) -> str:
        """Path of a file as it is now, or as it was if it is gone."""
        path = Path(self.recorded[name].path) if name in self.recorded else None
        if path is None or not path.is_file():
            return self.place(name)
        if not self.unchanged(name, path):
            self.notes.append(f"{name} has changed since, {path}: the present one is used")
        return str(path)

    def unchanged(self, name: str, path: Path) -> bool:
        entry = self.recorded.get(name)
        try:
            if not path.is_file() or path.stat().st_size > MAX_BYTES:
                return False
            return entry is not None and hashlib.sha256(config_content(name, path)).hexdigest() == entry.sha256
        except (RefusedError, OSError, ValueError):
            return False


def _with_priorities(files: _Files, options: RunOptions, robot: RobotBody | None, *, present: bool) -> Configs:
    last = PRIORITIES_OF.format("human" if robot is None else "robot")
    if options.priorities is not None or not present:
        options = replace(options, priorities=files.place(last))
    if robot is not None and present:
        files.notes += _changes(files, options, robot)
    elif robot is not None:
        human = {"reconstruct": files.place(PRIORITIES_OF.format("human"))}
        robot = replace(robot, profile=robot.profile.model_copy(update=human))
    return Configs(options, robot, tuple(files.notes), frozenset(files.attached))


def _changes(files: _Files, options: RunOptions, robot: RobotBody) -> Iterator[str]:
    now = {file.name: file for file, _ in config_files(options, robot)}
    for name in (name for name in {**files.recorded, **now} if name in now or name == CALIBRATION):
        if name not in now:
            yield f"{name} is missing now"
        elif name not in files.recorded:
            yield f"{name} is new: {now[name].path}"
        elif now[name].sha256 != files.recorded[name].sha256:
            yield f"{name} has changed: {now[name].path}"


def _recorded_robot(files: _Files, options: RunOptions, body: Path | None) -> RobotBody:
    path = Path(files.place(PROFILE))
    try:
        profile = read_profile(path)
        if body is None:
            body = Path(files.place(next((name for name in files.recorded if name.startswith("body.")), "body.xml")))
        profile = profile.model_copy(update={"body": str(body.resolve())})
        known = CALIBRATION in files.recorded
        calibration = read_calibration(profile, Path(files.place(CALIBRATION))) if known else None
        return robot_of(profile, calibration, root=options.root)
    except RefusedError as error:
        first = replace(error.problems[0], next_step="").render().rstrip(".").replace(f"{path.parent}/", "")
        more = f", and {len(error.problems) - 1} more" if len(error.problems) > 1 else ""
        where = str(files.recording.path)
        raise InputError(
            "the recorded robot cannot be used", where=where, found=first + more, next_step=ANOTHER
        ) from error
