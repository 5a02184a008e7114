"""A live run whose sensors come from your own Python code: your tracker takes the place of `read`."""

import numpy as np

from hardware.clock import VirtualClock
from retarget import RunOptions, measure
from retarget.live.begin import LiveOptions
from retarget.run.own_source import performing
from retarget.run.prepare import prepare_for
from retarget.sources.streams.stream_frame import StreamFrame
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer

STILL_S = 3.0


def main() -> None:
    """Two seconds of following, on a clock that need not wait; with real servos it is a MonotonicClock."""
    clock, person, chance = VirtualClock(), synthetic_performer(), np.random.default_rng(0)
    begin = clock.now()

    def read(now: float) -> list[StreamFrame]:
        """The poses that came since the last call: here one, who stands still first, with a sensor's noise."""
        seen = person.sample(float(np.clip(now - begin - STILL_S, 0.0, person.duration_s)))
        noisy = seen.position + chance.normal(0.0, 5e-4, seen.position.shape)
        return [StreamFrame(seen.names, noisy, seen.orientation, seen.valid, stamp=now)]

    performer = performing(read, LiveOptions(countdown=0.5, duration=2.0), clock=clock, notify=print)
    options = RunOptions(robot="op3", performer="five")
    with prepare_for(performer, options, clock=clock, make_bus=mock_bus, goes_to_rest=True) as prepared:
        report = measure(prepared.run())
    for name, tracking in report.tracking_mm.items():
        print(f"{name:10s} {tracking.mean:6.1f} mm off on average")


if __name__ == "__main__":
    main()
