"""Which recordings the experiments use: trials of CMU subject 2, found by name anywhere below a folder."""

from pathlib import Path

from retarget.errors import UsageError
from retarget.frames import SensorFrames
from retarget.sources.open import open_source

CROUCH, JOG, JUMP = "02_06", "02_03", "02_04"
"""Reach and crouch cycles (2,235 frames), a jog, a vertical jump."""
SUFFIXES = (".amc", ".bvh", ".c3d")
"""In order of preference: AMC has the recorded skeleton."""


def find_trial(folder: Path, trial: str) -> Path | None:
    """The file of a trial below a folder; None: there is none. Raises UsageError: no folder."""
    if not folder.is_dir():
        raise UsageError(
            "no folder of recordings",
            where="--mocap",
            found=str(folder),
            next_step="Leave --mocap out for the synthetic performer",
        )
    for suffix in SUFFIXES:
        found = sorted(folder.rglob(trial + suffix))
        if found:
            return found[0]
    return None


def read_trial(folder: Path | None, trial: str) -> SensorFrames | None:
    """The frames of a trial; None: no folder was given, or a trial other than CROUCH is not in it. Raises UsageError,
    InputError."""
    path = None if folder is None else find_trial(folder, trial)
    if folder is not None and path is None and trial == CROUCH:
        raise UsageError(
            "the trial of the experiments is not there",
            where="--mocap",
            found=f"no {' or '.join(trial + suffix for suffix in SUFFIXES)} below {folder}",
            next_step="Give the folder of CMU subject 2, or leave --mocap out for the synthetic performer",
        )
    return None if path is None else open_source(path)
