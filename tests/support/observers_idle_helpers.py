"""To be described."""

from retarget.schema.priorities import Priorities


def without_observers(priorities: Priorities) -> Priorities:
    """The same levels, empty where observers were."""
    levels = tuple(
        level.model_copy(update={"tasks": tuple(t for t in level.tasks if t.type not in ("reactive", "preventive"))})
        for level in priorities.levels
    )
    return priorities.model_copy(update={"levels": levels})
