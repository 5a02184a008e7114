"""The person who holds a robot while its servos have no torque, as one does with a real robot that cannot stand.

Until torque first goes on, the hand holds the whole robot still in its first posture: no time passes for its mechanics.
From then on it holds the root link where it is, ever more softly, and after RELEASE_S it has let go. It never comes
back: a robot whose torque goes off later is on its own.
"""

from typing import Any

import numpy as np

from retarget.body_file import engine

__all__ = ["RELEASE_S", "Hand", "add_hand"]

RELEASE_S = 0.6
"""From the first torque to the end of the hold, s."""
HAND = "physics_hand"
FIRM, LOOSE = 0.9, 0.001
"""Impedance of the hold (MuJoCo, solimp) at the beginning and at the end."""
SOLREF = (0.03, 1.0)
"""Time constant s and damping ratio of the hold: a soft grip."""


def add_hand(spec: Any, root: str) -> None:
    """Put a hand on the root link of a body."""
    mujoco = engine()
    spec.worldbody.add_body(name=HAND, mocap=True)
    hold = spec.add_equality(name=HAND, type=mujoco.mjtEq.mjEQ_WELD, name1=root, name2=HAND)
    hold.objtype = mujoco.mjtObj.mjOBJ_BODY
    hold.solref = SOLREF
    hold.solimp = [FIRM, FIRM, 0.001, 0.5, 2.0]


class Hand:
    """Holds the root link of a compiled model, and lets go. holding: whether it still does."""

    def __init__(self, model: Any, data: Any, root: int) -> None:
        self._model, self._data = model, data
        self._hold = model.equality(HAND).id
        self._released: float | None = None
        self.holding = True
        model.eq_data[self._hold] = 0.0
        model.eq_data[self._hold, 6] = 1.0  # relative orientation: none
        model.eq_data[self._hold, 10] = 1.0  # turns are held as firmly as places
        mocap = model.body(HAND).mocapid[0]
        data.mocap_pos[mocap] = data.qpos[:3]
        data.mocap_quat[mocap] = data.qpos[3:7]

    def let_go(self, now: float) -> None:
        """Begin to release at `now`, s of the engine; only the first time counts."""
        if self._released is None:
            self._released = now

    def ease(self, now: float) -> None:
        """Hold as firmly as is due at `now`, s of the engine."""
        if not self.holding or self._released is None:
            return
        share = (now - self._released) / RELEASE_S
        if share >= 1.0:
            self.holding = False
            self._data.eq_active[self._hold] = 0
            return
        firm = LOOSE + (FIRM - LOOSE) * 0.5 * (1.0 + float(np.cos(np.pi * share)))
        self._model.eq_solimp[self._hold, :2] = firm
