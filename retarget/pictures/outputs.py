"""Output files of a command: checked before anything moves, written at the end."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from retarget.errors import RefusedError, UsageError
from retarget.recording.npz import save_path, write_npz
from retarget.report.report import Report, write_report
from retarget.run.run_result import RunResult
from retarget.schema.files import check_folder, check_path, check_place, refuse_existing
from retarget.types import ShowProgress, no_progress

PICTURE_NAMES = ("tracking", "angles", "balance", "pressure", "poses")
"""Names of the files in `--plots DIR`, without importing Matplotlib."""
FILE_NAME, PAGE_NAME, RUN_NAME = "report.json", "report.html", "run.npz"
"""Names of the files in `--report DIR`, and of the run in the folder of a demo."""
PAGES = (".html", ".htm")
"""Suffixes of a page, which are refused as names of folders."""


def report_path(text: str | Path) -> Path:
    """The path of a report: FILE.json, or `report.json` in a folder. Raises UsageError if it is not
    writable."""
    path = Path(text)
    check_path(path, option="--report")
    page = page_path(path)
    if page is not None:
        check_folder(page.parent, option="--report")
        return page.with_name(FILE_NAME)
    check_place(path, option="--report")
    return path


def page_path(text: str | Path) -> Path | None:
    """The path of the page in a folder, None for FILE.json. Any other new name is a folder's. Raises UsageError
    for the name of a page."""
    path = Path(text)
    suffix = "" if path.is_dir() else path.suffix.lower()
    if suffix in PAGES:
        raise UsageError(
            "a page goes into a folder, beside its report",
            where="--report",
            found=str(path),
            allowed="FILE.json, or a folder",
            next_step=f"Give {path.with_suffix('')}",
        )
    return None if suffix == ".json" else path / PAGE_NAME


@dataclass(frozen=True)
class Outputs:
    """Output files of a run. page: path of the page of the report, set by `checked`.

    Results:
        report FILE.json|DIR: Write the numbers; into a folder, with a page.
        best_likeness: Add the best likeness that the joints allow.
        save FILE.npz: Write every tick, for other tools.
        plots DIR: Write pictures.
        animate FILE.webp: Write performer and robot moving (or .gif, .mp4).
        view [PORT] 0..65535: Show it on a web page of this machine.
        record FILE.mcap: Keep the run as it goes, for `retarget replay`.
        verbose: Print every figure, not the sentence alone.
        overwrite: Replace files that are there; else they are refused.
    """

    report: Path | None = None
    best_likeness: bool = False
    save: Path | None = None
    plots: Path | None = None
    animate: Path | None = None
    view: int | None = None
    record: Path | None = None
    verbose: bool = False
    overwrite: bool = False
    page: Path | None = None

    @property
    def measured(self) -> bool:
        """True if an output needs the whole run."""
        return any((self.report, self.page, self.save, self.plots, self.animate))

    def checked(self) -> "Outputs":
        """The outputs with the paths of their files. Raises UsageError if one is not writable, or exists."""
        if self.animate is not None:
            from retarget.pictures.solid import animation_path
        places = replace(
            self,
            report=None if self.report is None else report_path(self.report),
            page=None if self.report is None else page_path(self.report),
            save=None if self.save is None else save_path(self.save),
            animate=None if self.animate is None else animation_path(self.animate),
        )
        if self.plots is not None:
            check_folder(self.plots, option="--plots")
        if not self.overwrite:
            places.refuse_existing()
        return places

    @classmethod
    def in_folder(cls, folder: Path) -> "Outputs":
        """Return all outputs in one folder. Raises UsageError if it is not writable."""
        check_folder(folder, option="folder")
        return cls(report=folder / FILE_NAME, page=folder / PAGE_NAME, save=folder / RUN_NAME, plots=folder)

    def refuse_existing(self, option: str = "") -> None:
        """Raise UsageError if a file exists. option: for the message, by default that of the file."""
        places = [
            ("--report", self.report),
            ("--report", self.page),
            ("--save", self.save),
            ("--animate", self.animate),
        ]
        if self.plots is not None:
            places += [("--plots", self.plots / f"{name}.png") for name in PICTURE_NAMES]
        for own, path in places:
            if path is not None:
                refuse_existing(path, option=option or own)

    def write(self, run: RunResult, report: Report, *, progress: ShowProgress = no_progress) -> "WrittenFiles":
        """Write each output, even if others fail. KeyboardInterrupt ends an animation, whose progress is shown."""
        if self.page is not None or self.plots is not None:
            from retarget.pictures.page import write_page
            from retarget.pictures.plots import figures_of, write_plots
        if self.animate is not None:
            from retarget.pictures.solid import write_animation

        figures = cache(lambda: figures_of(run))  # page and pictures show the same
        tries: list[tuple[str, Path | None, Callable[[Path], object]]] = [
            ("report", self.report, lambda path: write_report(report, path)),
            ("run", self.save, lambda path: write_npz(run, path)),
            ("page", self.page, lambda path: write_page(run, report, path, figures=figures())),
            ("picture", self.plots, lambda path: write_plots(figures(), path)),
            ("animation", self.animate, lambda path: write_animation(run, path, progress=progress)),
        ]
        files = [("recording", path) for path in (self.record,) if path is not None and path.is_file()]
        problems: list[str] = []
        for what, path, write in tries:
            if path is None:
                continue
            try:
                made = write(path)
            except RefusedError as error:
                problems += [replace(one, where=f"{what} not written").render() for one in error.problems]
            except OSError as error:
                problems.append(f"{what} not written: {error}")
            except KeyboardInterrupt:
                problems.append(f"{what} not written: interrupted")
            else:
                files += [(what, file) for file in (made if isinstance(made, list) else [path])]
        return WrittenFiles(tuple(files), tuple(problems))


@dataclass(frozen=True)
class WrittenFiles:
    """Files that `Outputs.write` wrote. files: kind and path; problems: sentences on the others."""

    files: tuple[tuple[str, Path], ...]
    problems: tuple[str, ...]

    def listed(self, *, every: bool) -> str:
        """The files in words. every: list each of them, else one entry per folder."""
        paths = [path for _, path in self.files]
        if every:
            return ", ".join(map(str, paths))
        within = {folder: [path for path in paths if path.parent == folder] for folder in (one.parent for one in paths)}
        return ", ".join(
            str(own[0]) if len(own) == 1 else f"{len(own)} files in {folder}" for folder, own in within.items()
        )

    @property
    def first(self) -> Path | None:
        """The file to open first, None if there is none."""
        by_name = {path.name if what == "picture" else what: path for what, path in self.files}
        known = (by_name.get(what) for what in ("page", "animation", "poses.png", "report", "run", "recording"))
        return next(filter(None, known), None)
