"""Hand a recorded run on: joint positions in the layouts that spreadsheets, trainers and animation tools read."""

from retarget.exporting.export import FORMATS, export_motion, export_place, format_named
from retarget.exporting.motion import Motion, Tracks
from retarget.exporting.reading import read_run
from retarget.exporting.resample import resampled

__all__ = [
    "FORMATS",
    "Motion",
    "Tracks",
    "export_motion",
    "export_place",
    "format_named",
    "read_run",
    "resampled",
]
