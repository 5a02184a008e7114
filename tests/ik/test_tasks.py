"""One task of a priority file becomes tasks of the solver."""

import pytest

from retarget.ik.hierarchy import body_frames
from retarget.ik.tasks import Limb, SlotKind, compile_task
from retarget.model.human import build_human
from retarget.model.human_dimensions import proportional_dimensions
from retarget.schema.priorities import (
    AxisTask,
    HeadingTask,
    LimbTask,
    LookAtTask,
    OrientationTask,
    PositionTask,
    PostureTask,
    ReactiveTask,
    Task,
)

BODY = build_human(proportional_dimensions(1.7)).body
FRAMES = body_frames(BODY)
LIMBS = {"l_arm": Limb(FRAMES["chest"], FRAMES["l_wrist"], 0.5)}


@pytest.mark.parametrize(
    ("task", "kinds"),
    [
        (PositionTask(type="position", of=("head", "l_wrist")), [SlotKind.POSITION] * 2),
        (LimbTask(type="limb", of=("l_arm",), weight=0.1), [SlotKind.LIMB]),
        (OrientationTask(type="orientation", of=("chest",), weight=(1.0, 0.0, 2.0)), [SlotKind.ORIENTATION]),
        (AxisTask(type="axis", of=("pelvis",), axis=(0, 0, 2), direction=(0, 0, 3)), [SlotKind.AXIS]),
        (HeadingTask(type="heading", of=("pelvis",)), [SlotKind.HEADING]),
        (LookAtTask(type="look_at", of=("head",)), [SlotKind.LOOK_AT]),
        (PostureTask(type="posture", stiffness={"default": 1.0}), [SlotKind.POSTURE]),
        (PostureTask(type="posture", stiffness={"spine": 9.0}, settle=0.1), [SlotKind.POSTURE, SlotKind.PREVIOUS]),
        (ReactiveTask(type="reactive"), []),
    ],
)
def test_kinds(task: Task, kinds: list[SlotKind]) -> None:
    for is_soft in (False, True):
        slots = compile_task(task, BODY, FRAMES, fed=FRAMES, is_soft=is_soft, limbs=LIMBS)
        assert [slot.kind for slot in slots] == kinds


def test_tasks_that_nothing_feeds_are_left_out_but_axes_are_not() -> None:
    position = PositionTask(type="position", of=("head", "l_wrist"))
    assert [slot.name for slot in compile_task(position, BODY, FRAMES, fed={"head"}, is_soft=False, limbs=LIMBS)] == [
        "head"
    ]
    axis = AxisTask(type="axis", of=("pelvis",), axis=(0, 0, 1), direction=(0, 0, 1))
    assert len(compile_task(axis, BODY, FRAMES, fed=(), is_soft=False, limbs=LIMBS)) == 1
