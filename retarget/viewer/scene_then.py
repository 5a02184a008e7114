"""The scene of a recorded run: where its obstacles were at every tick."""

import numpy as np
from numpy.typing import NDArray

from retarget.errors import RefusedError
from retarget.record import Phase
from retarget.recording.configs import scene_as_then
from retarget.recording.cycles import Cycles
from retarget.recording.reading import Recording
from retarget.rotations import FloatArray
from retarget.scene import load_scene
from retarget.scene_motion import SceneState
from retarget.viewer.moment import Obstacle, drawn, obstacles, placed

__all__ = ["SceneThen"]


class SceneThen:
    """kept: the cycles that are shown, a row each. notes: why it is not shown, or that its file is another one now.

    A recording has its scene attached. Obstacles that were told of live are shown where the scene file has them.
    """

    def __init__(self, recording: Recording, kept: Cycles) -> None:
        self.obstacles: tuple[Obstacle, ...] = ()
        self.notes: tuple[str, ...] = ()
        self._state: SceneState | None = None
        self._times = recording.session.dt * _ticks(kept)
        try:
            with scene_as_then(recording) as (scene, self.notes):
                if scene is None:
                    return
                self._state = SceneState(load_scene(scene))
        except RefusedError as error:
            self.notes = (f"its scene is not shown: {error}",)
            return
        self.obstacles = obstacles(self._state.shapes)

    def at(self, row: int) -> FloatArray | None:
        """Poses (o, 7) of the obstacles; None without any."""
        return (
            None
            if self._state is None
            else placed(self._state.at_rest(float(self._times[row])).rows(drawn(self._state.shapes)))
        )


def _ticks(kept: Cycles) -> NDArray[np.int64]:
    """For how many ticks the obstacles had moved at each row: from the first that followed on, whenever one was led."""
    moves = (kept.phase != Phase.APPROACH) & ~kept.unled
    return np.asarray(np.cumsum(moves) - moves)
