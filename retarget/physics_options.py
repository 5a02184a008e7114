"""What a run with physics is asked to be: what the robot stands on, the seed, and trouble on purpose."""

from dataclasses import dataclass

from retarget.body_file import Root
from retarget.errors import UsageError, suggest

__all__ = ["MOUNTS", "TROUBLES", "PhysicsOptions"]

MOUNTS: dict[str, Root] = {"floor": "free", "stand": "fixed", "gantry": "suspended"}
"""What the robot is on, and the root with which it then follows."""
TROUBLES = ("mass", "centre_of_mass", "friction", "latency", "push")
MAX_SEED = 2**32 - 1


@dataclass(frozen=True)
class PhysicsOptions:
    """Options of `--bus physics`, named as on the command line. Raises UsageError for a value that cannot be meant.

    mount: of MOUNTS; None: as the profile's root says. hook: frame of the profile from which a gantry holds the robot;
    None: its frame `hook`. seed: of friction, of where in its tick each servo begins, and of what `trouble` draws.
    trouble: of TROUBLES, each at most once.
    """

    mount: str | None = None
    hook: str | None = None
    seed: int = 0
    trouble: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.mount is not None and self.mount not in MOUNTS:
            _refuse("unknown mount", "--mount", self.mount, tuple(MOUNTS))
        for trouble in self.trouble:
            if trouble not in TROUBLES:
                _refuse("unknown kind of trouble", "--trouble", trouble, TROUBLES)
        if len(set(self.trouble)) < len(self.trouble):
            found = ", ".join(self.trouble)
            raise UsageError("one kind of trouble twice", where="--trouble", found=found, next_step="Name each once")
        if not 0 <= self.seed <= MAX_SEED:
            raise UsageError("impossible seed", where="--seed", found=self.seed, allowed=f"0 to {MAX_SEED}")
        if self.hook is not None and self.mount in ("floor", "stand"):
            raise UsageError("only a gantry has a hook", where="--hook", found=f"--mount {self.mount}")

    @property
    def root(self) -> Root | None:
        """The root with which the robot follows; None: that of its profile."""
        return None if self.mount is None else MOUNTS[self.mount]


def _refuse(what: str, option: str, found: str, allowed: tuple[str, ...]) -> None:
    raise UsageError(
        what,
        where=option,
        found=repr(found[:80]),
        allowed=", ".join(allowed),
        next_step=suggest(found, allowed),
    )
