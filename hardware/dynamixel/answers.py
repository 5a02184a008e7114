"""What several servos said to one request, side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

from hardware.dynamixel.packets import Status


@dataclass(frozen=True, slots=True)
class Answers:
    """Of k servos: ids, in the order in which they came; error bytes (k); data, one after the other (k * size)."""

    ids: tuple[int, ...] = ()
    errors: bytes = b""
    data: bytes = b""

    def __len__(self) -> int:
        """How many servos."""
        return len(self.ids)

    @property
    def statuses(self) -> list[Status]:
        """One by one."""
        size = len(self.data) // len(self.ids) if self.ids else 0
        return [
            Status(device, self.errors[k], self.data[k * size : (k + 1) * size]) for k, device in enumerate(self.ids)
        ]


def side_by_side(statuses: Sequence[Status]) -> Answers:
    """Answers of equal size."""
    return Answers(
        tuple([status.id for status in statuses]),
        bytes([status.error for status in statuses]),
        b"".join([status.data for status in statuses]),
    )
