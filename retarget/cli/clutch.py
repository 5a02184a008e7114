"""Whether a person wants the robot to follow: a pause, and what must be held. The robot holds without."""

from collections.abc import Callable

from hardware.clock import Clock
from hardware.guard import Guard
from retarget.cli.dead_man import DeadMan
from retarget.live.performer import LivePerformer

__all__ = ["LONGEST_S", "Clutch"]

LONGEST_S = 300.0
"""So long a robot that was let go on purpose holds; servos that hold get warm, and somebody may have left."""


class Clutch:
    """Lets go of the performer and takes up again. guard: None where there is no robot. dead_man: what must be held,
    None: nothing."""

    def __init__(
        self,
        performer: LivePerformer,
        *,
        clock: Clock,
        tell: Callable[[str], object],
        guard: Guard | None = None,
        dead_man: DeadMan | None = None,
    ) -> None:
        self._performer, self._guard, self._dead_man = performer, guard, dead_man
        self._clock, self._tell = clock, tell
        self._paused, self._held = False, dead_man is None
        self._since: float | None = None  # [s] when it was let go
        self._lost = False
        self._apply()

    @property
    def engaged(self) -> bool:
        """Whether the performer is to be followed."""
        return self._held and not self._paused

    @property
    def paused(self) -> bool:
        """Whether somebody asked for a pause."""
        return self._paused

    @property
    def expired(self) -> bool:
        """Whether it has been let go for longer than a robot should hold."""
        return self._since is not None and self._clock.now() - self._since > LONGEST_S

    def look(self, pressed: str) -> None:
        """Once in every tick. pressed: keys of the terminal since the last look."""
        dead_man = self._dead_man
        if dead_man is None:
            return
        held = dead_man.held(pressed, self._clock.now())
        if dead_man.lost and not self._lost:
            self._lost = True
            self._tell(f"{dead_man.lost}: it counts as let go, for good; stop the run")
        if held != self._held:
            self._held = held
            self._tell("held" if held else "let go: the robot holds")
            self._apply()

    def pause(self) -> None:
        """Hold until `unpause`, whatever is held."""
        self._paused = True
        self._apply()

    def unpause(self) -> None:
        """No pause any more."""
        self._paused = False
        self._apply()

    def _apply(self) -> None:
        engaged = self.engaged
        self._performer.clutch(engaged=engaged)
        if self._guard is not None:
            self._guard.paused = not engaged
        self._since = None if engaged else self._clock.now() if self._since is None else self._since
