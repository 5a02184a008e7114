"""What is asked of a body: a crouch and reach that it can follow exactly, and the same out of reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.bodies import BenchBody, Floats

RATE = 120.0  # Hz
PERIOD = 3.0  # s, one crouch
OUT_OF_REACH = 2.0  # m


@dataclass(frozen=True, eq=False)
class Motion:
    """Targets of T frames: centre of mass (T, 3), points (T, k, 3), m. `start` (nq,); `com_rows`: weight of x, y, z."""

    name: str
    com: Floats
    points: Floats
    start: Floats
    com_rows: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.com)


def crouch_and_reach(body: BenchBody, frames: int) -> Motion:
    """A path of the joints with the left ankle at rest, seen through the tracked points: in reach, within speed."""
    model, solver_body = body.model, body.model.solver_body()
    time = np.arange(frames) / RATE
    share = 0.5 - 0.5 * np.cos(2.0 * np.pi * time / PERIOD)
    postures = np.tile(body.attractor, (frames, 1))
    for joint, angle in body.swing.items():
        postures[:, model.joint_qpos[model.joint_index(joint)]] += angle * share
    links, at = body.links(), body.offsets()
    ankle = solver_body.points(postures, links[:1], at[:1])[:, 0]
    postures[:, :3] += ankle[0] - ankle
    points, com = solver_body.points(postures, links, at), solver_body.centre_of_mass(postures)
    return Motion("easy", com, points, postures[0])


def out_of_reach(body: BenchBody, easy: Motion) -> Motion:
    """The same, with each wrist asked two metres ahead of where it can be."""
    away = [OUT_OF_REACH if "wrist" in point.name else 0.0 for point in body.points]
    points = easy.points + np.array(away)[None, :, None] * np.array([1.0, 0.0, 0.0])
    return Motion("wrists out of reach", easy.com, points, easy.start)
