"""A scene file: what stands or moves around the robot. `configs/scenes/*.yaml`.

Frames. `world` is the world of the run: for a robot its own, with the origin on the ground between its soles at the
start, x forward, y left, z up; for the virtual human the performer's. `stand` is fixed to what the robot stands or
hangs on: the mount of its base for a fixed or suspended root; for a free one the point on the ground between the soles
at the start, x forward. Time 0 is when the clip begins; before it, every obstacle is where it begins.
"""

from pathlib import Path

from retarget.catalogue import Kind, find
from retarget.scene_checks import check_obstacles
from retarget.scene_parts import Obstacle, Obstacles
from retarget.schema import Name, Schema, Text, read_model

__all__ = ["FLOOR", "Scene", "load_scene", "on_floor"]

FLOOR = "floor"
"""The obstacle on which a robot with feet stands, in every scene."""
FLOOR_MARGIN_M = 0.005
"""What is no sole keeps this distance from the floor: what servos sag by under load, and a hand's own skin."""
FLOOR_INFLUENCE_M = 0.05
"""Where observers begin to yield to it, as those of the shipped robots do to each other."""


class Scene(Schema):
    """Obstacles, by name."""

    name: Name
    """By which it is chosen."""
    description: Text
    """For whoever chooses."""
    obstacles: Obstacles
    """What is there, by name."""


def load_scene(name_or_path: str | Path) -> Scene:
    """A scene by shipped or user's name, or by path. Raises UsageError, ConfigError with all its problems."""
    scene, _ = read_model(
        Scene,
        find(Kind.SCENE, name_or_path),
        check=lambda scene, document: check_obstacles(scene.obstacles, document),
    )
    return scene


def on_floor(scene: Scene | None) -> Scene:
    """A scene for a robot that stands on its feet: with the floor z = 0, unless the scene has an obstacle of that name.

    scene: None, where nothing but the floor is around.
    """
    floor = {
        "shape": {"half_space": {"normal": (0.0, 0.0, 1.0)}},
        "influence": FLOOR_INFLUENCE_M,
        "margin": FLOOR_MARGIN_M,
        "ground": True,
    }
    if scene is None:
        return Scene.model_validate(
            {"name": FLOOR, "description": "Nothing but the floor", "obstacles": {FLOOR: floor}}
        )
    return scene.model_copy(update={"obstacles": {FLOOR: Obstacle.model_validate(floor)} | dict(scene.obstacles)})
