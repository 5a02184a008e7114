"""The tasks of a priority file, as models: what may be written shortly, and what is refused."""

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from retarget.priority_tasks import AxisTask, OrientationTask, PositionTask, PostureTask, Task

TASK: TypeAdapter[Task] = TypeAdapter(Task)


def read(**keys: Any) -> Task:
    return TASK.validate_python(keys)


@pytest.mark.parametrize("kind", ["position", "orientation"])
def test_one_number_weighs_all_rows_and_one_name_is_a_list(kind: str) -> None:
    task = read(type=kind, of="head", weight=2.0)
    assert isinstance(task, PositionTask | OrientationTask)
    assert task.weight == (2.0, 2.0, 2.0) and task.of == ("head",)
    assert read(type=kind, of=["head"], weight=[2.0, 2.0, 2.0]) == task


@pytest.mark.parametrize(
    "keys",
    [
        {"type": "position", "of": "head", "weight": 0.0},
        {"type": "position", "of": "head", "weight": True},
        {"type": "position", "of": []},
        {"type": "axis", "of": "head", "axis": [0, 0, 0], "direction": [0, 0, 1]},
        {"type": "axis", "of": "head", "axis": [0, 0, 1]},
        {"type": "reactive", "speed": 0.0},
        {"type": "reactive", "gain": 0.5},
        {"type": "centre_of_mass", "mode": "support", "moving": 1.5},
        {"type": "dance", "of": "head"},
    ],
)
def test_what_cannot_be_meant_is_refused(keys: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        read(**keys)


def test_what_is_left_out_has_its_usual_value() -> None:
    axis = read(type="axis", of="chest", axis=[0, 0, 1], direction=[0, 0, 1])
    assert isinstance(axis, AxisTask) and (axis.gain, axis.max_error, axis.optional) == (1.0, None, False)
    first, second = read(type="posture"), read(type="posture")
    assert isinstance(first, PostureTask) and isinstance(second, PostureTask)
    assert first.stiffness == {"default": 1.0} and first.stiffness is not second.stiffness
