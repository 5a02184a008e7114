"""The files that a command was asked to write: checked before anything moves, written when all is done."""

from dataclasses import dataclass
from pathlib import Path

import typer

from retarget.outputs import check_folder, make_folder
from retarget.report import Report, report_path, write_report
from retarget.run_result import RunResult
from retarget.save import save_path, write_npz

__all__ = ["Outputs"]


@dataclass(frozen=True)
class Outputs:
    """Where report, recording and pictures of a run go; None: nowhere."""

    report: Path | None = None
    save: Path | None = None
    plots: Path | None = None

    @classmethod
    def checked(cls, *, report: Path | None, save: Path | None, plots: Path | None) -> "Outputs":
        """Raise UsageError for the first place at which nothing can be written."""
        places = cls(None if report is None else report_path(report), None if save is None else save_path(save), plots)
        if plots is not None:
            check_folder(plots, option="--plots")
        return places

    @classmethod
    def in_folder(cls, folder: Path) -> "Outputs":
        """All of them in one folder, made when they are written. Raises UsageError if that cannot be."""
        check_folder(folder, option="folder")
        return cls(report=folder / "report.json", save=folder / "run.npz", plots=folder)

    def write(self, run: RunResult, report: Report) -> None:
        """Write what was asked for, and say where it is. Raises UsageError if a file cannot be written after all."""
        if self.plots is not None:
            make_folder(self.plots, option="--plots")
        if self.report is not None:
            write_report(report, self.report)
            _say("report", self.report)
        if self.save is not None:
            write_npz(run, self.save)
            _say("run", self.save)
        if self.plots is not None:
            from retarget.plots import write_plots

            for picture in write_plots(run, self.plots):
                _say("picture", picture)


def _say(what: str, path: Path) -> None:
    typer.echo(f"{what}: {path}")
