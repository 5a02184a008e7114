"""Limbs in the colour of the servo that turns them: by its temperature, or by how much current it draws."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray
from retarget.viewer.moment import Moment
from retarget.viewer.palette import mixed

if TYPE_CHECKING:
    import viser

__all__ = ["LOAD", "PLAIN", "TEMPERATURE", "LimbColours", "Scale", "current_scale", "temperature_scale"]

TEMPERATURE, LOAD, PLAIN = "temperature", "load", "nothing"
COLD_C = 30.0
"""Servos warmer than this begin to turn red; at the limit of the profile they are."""
SHADES = 12
"""Steps of colour: a shade that stays is not sent again."""


@dataclass(frozen=True, eq=False)
class Scale:
    """What a colour means. low, high: of the numbers at its ends. each (n,): the number at which a servo is red."""

    words: str
    unit: str
    low: float
    high: float
    each: FloatArray

    def shares(self, values: FloatArray) -> FloatArray:
        """From 0 to 1; 0 for what is not known."""
        return np.nan_to_num(np.clip((np.abs(values) - self.low) / (self.each - self.low), 0.0, 1.0))


class LimbColours:
    """Colours the links of a robot. `by`: TEMPERATURE, LOAD or PLAIN."""

    def __init__(self, robot: RobotBody, meshes: "Sequence[tuple[int, viser.MeshHandle]]") -> None:
        by_link, body = dict(meshes), robot.body
        self._handles = [by_link.get(int(body.joint_body[body.joint_index(j)])) for j in robot.joint_map.joints]
        self._shades = np.zeros(len(self._handles), dtype=int)
        self._scales = {TEMPERATURE: temperature_scale(robot), LOAD: current_scale(robot)}
        self.by = TEMPERATURE

    @property
    def choices(self) -> tuple[str, ...]:
        """What they can be coloured by."""
        return (*(name for name, scale in self._scales.items() if scale is not None), PLAIN)

    @property
    def scale(self) -> Scale | None:
        """Of the colours that are shown."""
        return self._scales.get(self.by)

    def show(self, moment: Moment) -> None:
        """Where the numbers are known."""
        values = {TEMPERATURE: moment.temperature, LOAD: moment.current}.get(self.by)
        scale, shades = self.scale, np.zeros_like(self._shades)
        if scale is not None and values is not None and len(values) == len(shades):
            shades = np.round(scale.shares(values) * SHADES).astype(int)
        for index in np.flatnonzero(shades != self._shades):
            handle = self._handles[index]
            if handle is not None:
                handle.color = mixed(shades[index] / SHADES)
        self._shades = shades


def temperature_scale(robot: RobotBody) -> Scale:
    """Red at the temperature that stops the robot."""
    limit = max(robot.profile.safety.temperature_c, COLD_C + 1.0)
    each = np.full(len(robot.joint_map), limit)
    return Scale("limbs by temperature of their servo; red: the robot stops", "\u00b0C", COLD_C, limit, each)


def current_scale(robot: RobotBody) -> Scale | None:
    """Red at the smallest current that the profile names: of a servo, of a warning or of a stop; None without any."""
    profile = robot.profile
    known = [limit for limit in (profile.safety.current_warn_a, profile.safety.current_a) if limit is not None]
    each = np.array([min([*known, *([own] if own is not None else [])], default=np.nan) for own in _own(robot)])
    if not np.isfinite(each).any():
        return None
    return Scale("limbs by current of their servo; red: as much as it may draw", "A", 0.0, float(np.nanmax(each)), each)


def _own(robot: RobotBody) -> list[float | None]:
    """Most current that each servo may draw, A, in servo order."""
    return [robot.profile.servos[joint].current for joint in robot.joint_map.joints]
