"""What touches at the start is named, and refused unless it may be let out."""

from pathlib import Path

import numpy as np
import pytest

from followers import op3
from gated_robot import scene, sphere
from hardware.clock import VirtualClock
from retarget.catalogue import Kind, find
from retarget.cli.buses import make_bus
from retarget.clip import Playback
from retarget.contact_at_start import Contact, contacts, refuse_contact
from retarget.errors import UsageError
from retarget.observer_pairs import placed
from retarget.observers import robot_observers
from retarget.options import RunOptions
from retarget.prepare import prepare
from retarget.rotations import FloatArray
from retarget.stance import plant
from sim.performer import synthetic_performer
from support.messages import refuses

BALL = """
name: swallowed
description: a ball around a hand
obstacles:
  ball: {shape: {sphere: {radius: 0.06}}, at: {pos: [%f, %f, %f]}, influence: 0.1}
"""


def standing() -> FloatArray:
    return plant(op3(), op3().profile.postures.stand).q


def hand() -> FloatArray:
    place: FloatArray = op3().points(standing()[None], ("l_hand",))[0, 0]
    return place


def test_a_robot_that_stands_touches_nothing() -> None:
    assert contacts(op3().body, robot_observers(op3()), None, standing()) == ()


def test_the_deepest_comes_first_with_its_depth() -> None:
    observers, q = robot_observers(op3()), standing()
    torso, forearm = placed(op3().body, observers, q)[0][[observers.names.index(n) for n in ("torso", "l_forearm")]]
    state = scene(far=sphere([2.0, 0.0, 0.0], 0.1), ball=sphere(torso, 0.02), grain=sphere(forearm, 0.001))
    found = contacts(op3().body, observers, state, q)
    assert found[0].part == "torso" and found[0].other == "ball" and 0.02 < found[0].depth < 0.2
    assert {contact.other for contact in found} == {"ball", "grain"}
    assert np.all(np.diff([contact.depth for contact in found]) <= 0.0)


def test_the_message_names_all_of_them() -> None:
    refuse_contact((), where="op3")
    both = (Contact("torso", "ball", 0.012), Contact("head", "ball", 0.003))
    with refuses(UsageError, "12.0", "head", "3.0", "--allow-contact"):
        refuse_contact(both, where="op3, standing")


@pytest.mark.parametrize("robot", ["op3", "human"])
def test_a_swallowed_start_is_refused_before_anything_moves(robot: str, tmp_path: Path) -> None:
    frames = synthetic_performer()
    # An ankle of the paper's human is where its sensor says, whatever touches it.
    at = hand() if robot == "op3" else frames.position[0, frames.index("l_ankle")]
    priorities = None if robot == "op3" else str(tmp_path / "lines.yaml")
    paper = find(Kind.PRIORITIES, "paper").read_text(encoding="utf-8")
    lines = [line for line in paper.splitlines() if not line.startswith("observers:")]
    (tmp_path / "lines.yaml").write_text("\n".join([*lines, "observers: {human: lines}"]))
    file = tmp_path / "swallowed.yaml"
    file.write_text(BALL % tuple(at))

    def options(*, allow: bool) -> RunOptions:
        return RunOptions(
            robot=robot, priorities=priorities, scene=str(file), allow_contact=allow, playback=Playback(end=0.2)
        )

    with (
        refuses(UsageError, "--allow-contact"),
        prepare(
            lambda: frames,
            options(allow=False),
            clock=VirtualClock(),
            make_bus=lambda robot, clock: make_bus("mock", robot, clock),
        ),
    ):
        pass
    with prepare(
        lambda: frames,
        options(allow=True),
        clock=VirtualClock(),
        make_bus=lambda robot, clock: make_bus("mock", robot, clock),
    ) as prepared:
        assert len(prepared.run().record) > 0
