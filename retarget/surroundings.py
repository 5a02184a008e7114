"""What is around a body while it moves: the scene over time, handed to the hierarchy tick by tick."""

from retarget.hierarchy import Hierarchy
from retarget.observers import NO_SCENE
from retarget.scene_motion import ObstaclePoses, SceneState
from retarget.scene_shapes import SceneShapes

__all__ = ["Surroundings"]


class Surroundings:
    """The obstacles that one hierarchy sees. Until `begin` they stand where they are at time 0; time is s of the
    scene."""

    def __init__(self, scene: SceneState | None) -> None:
        self.scene = scene
        self.time = 0.0
        """Of the tick that comes next."""
        self.now: ObstaclePoses | None = None
        """Where they are at the start of the tick that runs; None: nothing is around."""
        self._runs = False
        self.look()

    @property
    def shapes(self) -> SceneShapes:
        """What the hierarchy is built with."""
        return NO_SCENE if self.scene is None else self.scene.shapes

    def restart(self) -> None:
        """Back to time 0, at rest; what was told live is forgotten."""
        if self.scene is not None:
            self.scene.restart()
        self.time, self._runs = 0.0, False
        self.look()

    def look(self) -> None:
        """Where they are now, as long as they do not move by the file: somebody may tell of them live."""
        if self.scene is not None and not self._runs:
            self.now = self.scene.at_rest(self.time)

    def begin(self) -> None:
        """From the next tick on they move, from time 0."""
        self.time, self._runs = 0.0, False
        self.look()
        self._runs = True

    def tick(self, hierarchy: Hierarchy | None, dt: float, *, pace: float = 1.0) -> None:
        """Tell the hierarchy (None: nobody) where they are at the start of a tick of `dt` s, and let time go on.

        pace: s of the hierarchy's time that go by in a second: the slower it is, the faster all else seems to it.
        """
        if self.scene is None:
            return
        self.now = self.scene.at(self.time) if self._runs else self.scene.at_rest(self.time)
        if hierarchy is not None:
            hierarchy.set_obstacles(self.now if pace == 1.0 else self.now.seen_at(pace))
        if self._runs:
            self.time += dt
