"""Who watches a simulated robot through a run: its present state, its log, and whether it fell."""

from hardware.arrays import BoolArray
from sim.physics.fall import Fall, FallWatch
from sim.physics.log import PhysicsLog
from sim.physics.mount import Support
from sim.physics.simulation import Simulation
from sim.physics.state import PhysicsState, StateReader

__all__ = ["AFTERMATH_S", "Witness"]

AFTERMATH_S = 1.5
"""How long a robot is watched after its torque went off for good, s: whether it goes down."""
LOOK_S = 0.008
"""Between two looks then, s."""


class Witness:
    """state: as of the last `look`. log: of every look since torque first went on. parked: whether the robot was in
    its rest posture when its torque went off last: then going down is sitting down."""

    def __init__(self, simulation: Simulation) -> None:
        world = simulation.world
        self.simulation = simulation
        self._reader = StateReader(simulation)
        stands = world.mount.support is Support.FLOOR
        self._watch = FallWatch(world.robot) if stands else None
        self._sitting = FallWatch(world.robot) if stands else None
        self._powered = False
        self.parked = False
        self.state: PhysicsState = self._reader.read()
        self.log = PhysicsLog(
            servos=len(world.drives),
            soles=len(world.soles),
            corners=self._reader.corner_soles,
            nq=world.robot.body.nq,
            loaded=self._reader.loaded,
        )

    @property
    def fall(self) -> Fall | None:
        """The first fall; None: it has not fallen, or hangs."""
        return None if self._watch is None else self._watch.fall

    @property
    def soles(self) -> BoolArray | None:
        """Which soles (k,) carried at the last look; None: a hand holds the robot, or its feet are in the air for
        good."""
        if self._watch is None or self.simulation.held:
            return None
        return self._reader.loaded(self.state.load)

    @property
    def fallen(self) -> bool:
        """Whether it has fallen."""
        return self.fall is not None

    @property
    def toppled(self) -> Fall | None:
        """What a parked robot did when its torque went off, if it did not stay sitting; no `fall`, but no good rest
        posture either."""
        return None if self._sitting is None else self._sitting.fall

    def look(self) -> None:
        """Take the state of now."""
        self.state = state = self._reader.read()
        if self.simulation.moves:
            self.log.add(state)
            self._judge(state)

    def switched(self, on: bool) -> None:
        """Torque has been switched."""
        if self._powered and not on and self._watch is not None:
            self.parked = self._watch.parks(self._reader.read().q)
        self._powered = on

    def see_it_out(self) -> None:
        """Let AFTERMATH_S go by on the simulation's own time, and look on."""
        if self._watch is None or not self.simulation.moves:
            return
        for _ in range(round(AFTERMATH_S / LOOK_S)):
            self.simulation.advance(self.simulation.time + LOOK_S)
            self._judge(self._reader.read())

    def _judge(self, state: PhysicsState) -> None:
        watch = self._sitting if self.parked and not self._powered else self._watch
        if watch is not None:
            watch.look(state, powered=self._powered)
