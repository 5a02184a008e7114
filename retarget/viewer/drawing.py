"""A moment of a run as shapes in the scene of the page."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from retarget.rotations import FloatArray, multiply, rotate
from retarget.viewer.moment import Actor, Cast, Moment
from retarget.viewer.overlays import Around, Observing, Soles, Warmth

if TYPE_CHECKING:
    import viser

__all__ = ["Drawing"]

Colour = tuple[int, int, int]

ROBOT: Colour = (74, 98, 132)
GOAL: Colour = (242, 158, 46)
HUMAN: Colour = (176, 186, 196)
ASKED: Colour = (214, 64, 69)
REACHED: Colour = (46, 134, 84)
BALANCE: Colour = (126, 87, 194)
GOAL_OPACITY = 0.2
BESIDE = 1.15
"""The performer stands so many heights of the robot to its left, as tall as it."""


class Drawing:
    """Puts robot, goal, performer, landmarks and centre of mass into the scene of a server; `show` moves them."""

    def __init__(self, server: "viser.ViserServer", cast: Cast, first: Moment) -> None:
        scene, human = server.scene, cast.human
        self._scene, self._server = scene, server
        scene.set_up_direction("+z")
        height = human.height if cast.robot is None else cast.robot.height
        scene.add_grid(
            "/floor", 20.0, 20.0, cell_size=0.1, section_size=0.5, cell_color=(225, 228, 232), fade_distance=8.0
        )
        self._robot = self._goal = None
        place = np.zeros(3)
        if cast.robot is not None:
            self._robot = _Figure(scene, "robot", cast.robot, colour=ROBOT)
            self._goal = _Figure(scene, "goal", cast.robot, colour=GOAL, opacity=GOAL_OPACITY)
            place = np.array([0.0, BESIDE * height, 0.0])
        at = _Place(
            scale=height / human.height, origin=first.human[:3] * (1.0, 1.0, 0.0), turn=_ahead(human, first), to=place
        )
        self._human = _Figure(scene, "performer", human, colour=HUMAN, at=at)
        self._overlays: dict[str, Observing | Soles | Warmth | Around] = {}
        if cast.around:
            self._overlays["around"] = Around(scene, cast.around)
        if cast.robot is not None and cast.profile is not None and self._robot is not None:
            self._overlays["observers"] = Observing(scene, cast.profile)
            if cast.profile.stands:
                self._overlays["soles"] = Soles(scene, cast.profile)
            self._overlays["warmth"] = Warmth(cast.profile, self._robot.meshes, colour=ROBOT)
        size = 0.018 * height
        self._asked = [scene.add_icosphere(f"/asked/{name}", size, color=ASKED) for name in cast.landmarks]
        self._reached = [scene.add_icosphere(f"/reached/{name}", size, color=REACHED) for name in cast.landmarks]
        self._balance = scene.add_icosphere("/balance/centre", 1.3 * size, color=BALANCE)
        self._shadow = scene.add_cylinder("/balance/below", 1.6 * size, 0.002, color=BALANCE)
        server.initial_camera.position = (2.6 * height, 0.55 * height, 1.2 * height)
        server.initial_camera.look_at = (0.0, 0.5 * BESIDE * height if cast.robot else 0.0, 0.5 * height)

    def show(self, moment: Moment) -> None:
        """Move everything to where it is."""
        with self._server.atomic():
            if self._robot is not None and self._goal is not None:
                self._robot.place(moment.robot)
                self._goal.place(moment.goal)
            self._human.place(moment.human)
            for shape, at in zip([*self._asked, *self._reached], [*moment.asked, *moment.reached], strict=True):
                known = bool(np.isfinite(at).all())
                if shape.visible != known and "/asked" in shape.name:
                    shape.visible = known
                if known:
                    shape.position = tuple(at.tolist())
            for overlay in self._overlays.values():
                overlay.show(moment)
            x, y, z = moment.com.tolist()
            self._balance.position, self._shadow.position = (x, y, z), (x, y, 0.001)

    def see(self, part: str, *, visible: bool) -> None:
        """Show or hide one of `parts`."""
        overlay = self._overlays.get(part)
        if overlay is not None:
            overlay.see(visible=visible)
        for handle in self._parts(part):
            handle.visible = visible

    @property
    def parts(self) -> tuple[str, ...]:
        """What can be hidden."""
        bodies = ("performer",) if self._robot is None else ("robot", "goal", "performer")
        return (*bodies, "asked", "reached", "balance", *self._overlays)

    def _parts(self, part: str) -> "list[viser.SceneNodeHandle]":
        figure = {"robot": self._robot, "goal": self._goal, "performer": self._human}.get(part)
        if figure is not None:
            return [handle for _, handle in figure.meshes]
        if part == "balance":
            return [self._balance, self._shadow]
        return [*{"asked": self._asked, "reached": self._reached}.get(part, [])]


@dataclass(frozen=True, eq=False)
class _Place:
    """Where the world of a body is in the scene: `scale` times as large, its point `origin` at `to` (3,) m, turned."""

    scale: float = 1.0
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))
    turn: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    to: FloatArray = field(default_factory=lambda: np.zeros(3))

    def of(self, positions: FloatArray, turns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Poses of links, (n, 3) m and (n, 4), in the scene."""
        return self.to + self.scale * rotate(self.turn, positions - self.origin), multiply(self.turn, turns)


class _Figure:
    """A body in the scene."""

    def __init__(
        self,
        scene: "viser.SceneApi",
        name: str,
        actor: Actor,
        *,
        colour: Colour,
        opacity: float | None = None,
        at: "_Place | None" = None,
    ) -> None:
        self._body, self._at = actor.body.solver_body(), at or _Place()
        self.meshes = [
            (
                mesh.link,
                scene.add_mesh_simple(
                    f"/{name}/{actor.body.body_names[mesh.link]}",
                    (self._at.scale * mesh.vertices).astype(np.float32),
                    mesh.faces,
                    color=colour,
                    opacity=opacity,
                    flat_shading=False,
                    cast_shadow=opacity is None,
                ),
            )
            for mesh in actor.meshes
        ]

    def place(self, q: FloatArray) -> None:
        """Pose it in posture q (nq,)."""
        positions, turns = self._at.of(*self._body.forward(np.ascontiguousarray(q)))
        for link, handle in self.meshes:
            handle.position = tuple(positions[link].tolist())
            handle.wxyz = tuple(turns[link].tolist())


def _ahead(human: Actor, first: Moment) -> FloatArray:
    """The turn about the vertical, wxyz (4,), after which the performer looks along x in the beginning."""
    _, turns = human.body.solver_body().forward(np.ascontiguousarray(first.human))
    x, y, _ = rotate(turns[1], np.array([1.0, 0.0, 0.0])).tolist()
    half = -0.5 * np.arctan2(y, x)
    return np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
