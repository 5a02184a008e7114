"""Rendered performers as the body tracker sees them: clips by name, their recorded landmarks, and the truth.

`python tests/support/camera_clips.py RUNTIME FOLDER` draws them, runs the tracker in a headless browser and writes the
landmarks (RUNTIME: the folder of `retarget.web.runtime`).
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rendered as draw
from landmarks import seen, tracker, write_frames
from retarget.model.human import Human
from retarget.sources.streams.camera import ANKLES, EARS, ELBOWS, HIPS, KNEES, LANDMARKS, NOSE, SHOULDERS, WRISTS


@dataclass(frozen=True)
class Clip:
    """A motion, and how it is drawn."""

    motion: Callable[[], draw.Motion]
    face: bool = True
    distance: float = draw.DISTANCE


def _person() -> Human:
    return draw.performer(1.75)


CLIPS: Mapping[str, Clip] = {
    "still": Clip(lambda: draw.standing(_person(), 10.0)),
    "wave": Clip(lambda: draw.waving(_person())),
    "front": Clip(lambda: draw.raising(_person(), "l")),
    "aside": Clip(lambda: draw.raising(_person(), "lr", swing=-40.0)),
    "crouch": Clip(lambda: draw.crouching(_person())),
    "step": Clip(lambda: draw.stepping(_person())),
    "bare": Clip(lambda: draw.raising(_person(), "l"), face=False),
}


USED = {NOSE, *EARS, *SHOULDERS, *ELBOWS, *WRISTS, *HIPS, *KNEES, *ANKLES}
"""Landmarks that the decoder reads."""
EVERY = 2
"""Pictures of the motion from one that the tracker sees to the next: 15 a second, a slow phone."""


def seen_clip(page: Any, clip: Clip) -> list[dict[str, Any]]:
    """The frames of a clip through the tracker's page, see `landmarks.seen`."""
    whole = clip.motion()
    motion = draw.Motion(whole.human, whole.q[::EVERY], whole.joints[::EVERY])
    pictures = draw.drawn(motion, face=clip.face, distance=clip.distance)
    return seen(page, pictures, rate=draw.RATE / EVERY)


def main(runtime: Path, folder: Path, *names: str) -> None:
    """Write the landmarks of the clips of these names, of all without one."""
    with tracker(runtime) as page:
        for name in names or CLIPS:
            frames = seen_clip(page, CLIPS[name])
            for frame in frames:
                for unused in set(range(LANDMARKS if frame["landmarks"] else 0)) - USED:
                    frame["landmarks"][unused] = [0, 0, 0, 0, 0, 0]  # so that the file is small
            write_frames(folder / f"{name}.jsonl.gz", frames)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:])
