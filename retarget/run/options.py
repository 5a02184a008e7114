"""Options of a run, checked before any file is opened, and the priority files that they select."""

from dataclasses import dataclass, field
from math import inf, nan
from pathlib import Path
from typing import get_args

from retarget.errors import UsageError, suggest
from retarget.human.samples import Parts, Playback
from retarget.model.body_file import Root
from retarget.model.robot import Mounting, RobotBody
from retarget.schema.catalogue import HUMAN
from retarget.schema.priorities import Legs, Steps

MOUNTS: dict[str, Root] = {"floor": "free", "stand": "fixed", "gantry": "suspended"}
"""The support of the robot, and the root with which it then follows."""
PERTURBATIONS: dict[str, tuple[float, float] | None] = {
    "mass": (0.5, 2.0),
    "centre_of_mass": None,
    "friction": (0.05, 2.0),
    "latency": (0.0, 0.2),
    "stiffness": (0.1, 10.0),
    "push": None,
}
"""Range of the number after `=`: factors of mass and stiffness, a coefficient, s. None: only drawn."""
MAX_SEED = 2**32 - 1  # 32 bits, which every generator takes


@dataclass(frozen=True)
class PhysicsOptions:
    """Options of `--bus physics`, named as on the command line. Raises UsageError.

    Physics:
        mount floor|stand|gantry: Its support; usually by its profile's root.
        hook FRAME: Frame by which a gantry holds it; usually 'hook'.
        perturbations (--perturb) KIND[=X]: mass, centre_of_mass, friction, latency, stiffness or push, drawn by the
            seed or as given (stiffness=0.7). Also several times.
        seed N: Seed of all random choices.
    """

    mount: str | None = None
    hook: str | None = None
    seed: int = 0
    perturbations: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.mount is not None:
            _one_of(self.mount, tuple(MOUNTS), "--mount", "mount")
        kinds = [perturbation_of(text)[0] for text in self.perturbations]
        if len(set(kinds)) < len(kinds):
            found = ", ".join(self.perturbations)
            raise UsageError("one perturbation twice", where="--perturb", found=found, next_step="Name each once")
        if not 0 <= self.seed <= MAX_SEED:
            raise UsageError("impossible seed", where="--seed", found=self.seed, allowed=f"0 to {MAX_SEED}")
        if self.hook is not None and self.mount in ("floor", "stand"):
            raise UsageError("only a gantry has a hook", where="--hook", found=f"--mount {self.mount}")

    @property
    def root(self) -> Root | None:
        """The root with which the robot follows; None: that of its profile."""
        return None if self.mount is None else MOUNTS[self.mount]


def perturbation_of(text: str) -> tuple[str, float | None]:
    """A perturbation, and its number, if given. Raises UsageError."""
    kind, given, number = text.partition("=")
    _one_of(kind, tuple(PERTURBATIONS), "--perturb", "perturbation")
    within = PERTURBATIONS[kind]
    if not given:
        return kind, None
    try:
        value = float(number)
    except ValueError:
        value = nan
    if within is None or not within[0] <= value <= within[1]:
        allowed = f"{kind} alone" if within is None else f"{kind}={within[0]:g} to {kind}={within[1]:g}"
        raise UsageError("impossible perturbation", where="--perturb", found=repr(text[:80]), allowed=allowed)
    return kind, value


def _one_of(value: str, allowed: tuple[str, ...], option: str, what: str, also: str = "") -> None:
    if value not in allowed:
        raise UsageError(
            f"unknown {what}",
            where=option,
            found=repr(value[:80]),
            allowed=", ".join(allowed) + (f", or {also}" if also else ""),
            next_step=suggest(value, allowed),
        )


BUSES = ("mock", "emulator", "physics", "physics+wire", "none", "profile")
"""Buses by name; other names are a port, or `module:Class`."""
SIMULATED = ("mock", "emulator", "physics", "physics+wire", "none")
"""Buses without real servos: a recording is played as fast as the machine can."""
PHYSICS = ("physics", "physics+wire")  # the simulated robot has mass; the second passes the emulator's bytes
WIRED = ("emulator", "physics+wire")  # buses with an emulated wire, on which faults can be injected
SERVOLESS = ("mock", "none")
"""Buses without current, voltage and temperature."""
MAX_ITERATIONS = 100  # twenty times the paper's: more is a mistyped value


@dataclass(frozen=True)
class RunOptions:
    """Options of a run, named as on the command line. Raises UsageError for an impossible value.

    None: as the robot's profile or the priority files say; of `performer`, five. gate: whether goals are checked before
    they are sent.

    Robot:
        robot NAME|PATH: By name or path; or 'human' alone.
        bus NAME|PORT: mock, emulator, physics, physics+wire, none; real: profile, PORT, module:Class.
        performer NAME|FILE: The sensors: five (usual), five_head, three, six, ten, all, avatar, optitrack, web, ...,
            or a file.
        priorities NAME|FILE: Priority file of the robot (of 'human': its own).
        scene NAME|FILE: The scene: table, wall, ..., or a file.
        max_force N: The hands press with so many N at most beyond what carries the arms, stretched.
        allow_contact: Begin also where the body touches the scene.
        stand_at_end: End standing, with torque.
        torque_off_at_end: End at rest, even if it topples there.
        parts whole|upper: Moving parts; 'upper' keeps the legs still.
        legs free: Pelvis and feet as the performer's; on no servos.
        steps MODE: When the performer walks: planted (usual), walk, follow (of a robot that hangs).
        iterations (--n-ik) N: Iterations per frame at most, both stages.
        faults FILE.yaml: Faults on the emulator's wire.

    Playback:
        speed X: 1 is the performer's speed.
        start S: Begin at this time of the recording.
        end S: End at this time; live: after so long.
        loop: Again and again until Ctrl-C, 10 minutes at most.
        keep_calibration_frame: Play a T, A or N pose before the motion, too.
        mirror: Swap left and right.
    """

    robot: str
    bus: str = "mock"
    performer: str | None = None
    priorities: str | None = None
    iterations: int | None = None
    parts: Parts = "whole"
    steps: Steps | None = None
    legs: Legs | None = None
    gate: bool = True
    scene: str | None = None
    max_force: float | None = None
    allow_contact: bool = False
    stand_at_end: bool = False
    torque_off_at_end: bool = False
    faults: Path | None = None
    physics: PhysicsOptions = field(default_factory=PhysicsOptions)
    playback: Playback = field(default_factory=Playback)

    def __post_init__(self) -> None:
        if "/" not in self.bus and ":" not in self.bus:  # a path of a port, or a class of the user's
            _one_of(self.bus, BUSES, "--bus", "bus", also="a port such as /dev/ttyUSB0, or module:Class")
        _one_of(self.parts, get_args(Parts), "--parts", "choice of parts")
        if self.steps is not None:
            _one_of(self.steps, get_args(Steps), "--steps", "behaviour of the feet")
        if self.legs is not None:
            _one_of(self.legs, get_args(Legs), "--legs", "choice of legs")
        if self.iterations is not None and not 1 <= self.iterations <= MAX_ITERATIONS:
            allowed = f"1 to {MAX_ITERATIONS}"
            raise UsageError("impossible number of iterations", where="--n-ik", found=self.iterations, allowed=allowed)
        if self.max_force is not None and not 0.0 < self.max_force < inf:
            raise UsageError("impossible force", where="--max-force", found=self.max_force, allowed="above 0 N")
        if self.is_human:
            self._check_human()
        bus = f"--bus {self.bus}"
        if self.faults is not None and self.bus not in WIRED:
            allowed = " or ".join(f"--bus {name}" for name in WIRED)
            raise UsageError("only the emulator has faults to inject", where="--faults", found=bus, allowed=allowed)
        if self.physics != PhysicsOptions() and not self.has_physics:
            mass = self.physics
            options = {"--mount": mass.mount, "--hook": mass.hook, "--seed": mass.seed, "--perturb": mass.perturbations}
            given = ", ".join(option for option, value in options.items() if value)
            allowed = " or ".join(f"--bus {name}" for name in PHYSICS)
            raise UsageError("only a simulated robot with mass takes this", where=given, found=bus, allowed=allowed)
        if not self.gate and not self.simulated:
            raise UsageError("no goal goes to real servos unchecked", where="--no-gate", found=bus)
        if self.stand_at_end and self.torque_off_at_end:
            step = "Leave one out; --no-stand-at-end undoes what a session file says"
            found = "--torque-off-at-end as well"
            raise UsageError("a run has one end", where="--stand-at-end", found=found, next_step=step)
        if self.legs is not None:
            self._check_free_legs()
        if self.steps == "walk" and self.scene is not None:
            raise UsageError(
                "a robot walks on a free floor",
                where="--steps walk",
                found=f"--scene {self.scene}",
                next_step="Leave one of them out: its way to rest is planned where it begins",
            )
        if self.steps == "walk" and self.parts != "whole":
            raise UsageError("legs that do not move make no steps", where="--steps", found=f"--parts {self.parts}")

    def _check_human(self) -> None:
        robot = f"--robot {HUMAN}"
        for option, given, what in (
            ("--parts", self.parts != "whole", "parts are parts of a robot"),
            ("--legs", self.legs is not None, "a human's legs are the performer's"),
            ("--steps", self.steps is not None, "a human's feet are the performer's"),
            ("--bus", self.bus not in SERVOLESS, "a human has no servos"),
            ("--max-force", self.max_force is not None, "a human's hands are not limited"),
            ("--no-gate", not self.gate, "there is no gate to leave out"),
        ):
            if given and option == "--bus":
                found = f"{robot}, --bus {self.bus}"
                raise UsageError(what, where=option, found=found, allowed="none, or no --bus")
            if given:
                raise UsageError(what, where=option, found=robot)

    def _check_free_legs(self) -> None:
        if self.bus not in SERVOLESS:
            raise UsageError(
                "a robot with free legs would fall",
                where="--legs free",
                found=f"--bus {self.bus}",
                allowed=" or ".join(f"--bus {name}" for name in SERVOLESS),
                next_step="It is to look at or to train on: leave --legs out, or --bus",
            )
        others = {"--parts": self.parts != "whole", "--steps": self.steps is not None}
        for option in filter(others.__getitem__, others):
            raise UsageError("free legs go where the performer's go", where=option, next_step="Leave it out")

    @property
    def performer_name(self) -> str:
        """Name or file of the performer's sensors."""
        return self.performer or "five"

    @property
    def simulated(self) -> bool:
        """True without real servos, so that time need not be real."""
        return self.bus in SIMULATED

    @property
    def has_physics(self) -> bool:
        """True if the robot's mass is simulated."""
        return self.bus in PHYSICS

    @property
    def has_mass(self) -> bool:
        """True if the robot has mass, real or simulated, and can tip."""
        return self.has_physics or not self.simulated

    @property
    def root(self) -> Mounting | None:
        """The root with which the robot follows; None: that of its profile."""
        return "floating" if self.legs else self.physics.root

    @property
    def is_human(self) -> bool:
        """True if only the performer is reconstructed."""
        return self.robot == HUMAN


HUMAN_PRIORITIES = "human"
WITHOUT_MASS = "servo"  # priority file of a robot without mass; one with mass uses one of the next two
STANDING_WITH_MASS, FIXED_WITH_MASS = "balanced", "fixed_base"
"""Priority files of a robot on its soles, and of another one, whose servos lag."""
FREE_LEGS = "free_legs"  # priority file of a robot that nothing carries


def priority_names(robot: RobotBody | None, options: RunOptions) -> tuple[str, ...]:
    """The priority files of the stages; `--priorities` replaces that of the last stage."""
    if robot is None:
        return (options.priorities or HUMAN_PRIORITIES,)
    if options.legs:
        return robot.profile.reconstruct, options.priorities or FREE_LEGS
    usual = name_with_mass(robot) if options.has_mass or options.steps == "walk" else robot.profile.retarget
    return robot.profile.reconstruct, options.priorities or usual


def name_with_mass(robot: RobotBody) -> str:
    """The priority file of a robot with mass, if no option names one."""
    profile = robot.profile
    if robot.stands and profile.standing is not None:
        return profile.standing
    if profile.retarget != WITHOUT_MASS:
        return profile.retarget
    return STANDING_WITH_MASS if robot.stands else FIXED_WITH_MASS
