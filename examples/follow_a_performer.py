"""A performer moves an OP3 on a mock bus: give a motion file, or none for the shipped sample."""

import sys

from hardware.clock import VirtualClock
from retarget import RunOptions, measure, open_source
from retarget.run.prepare import prepare
from sim.mock_bus import mock_bus


def main(source: str = "sample") -> None:
    """Run and print what the hands did."""
    options = RunOptions(robot="op3")
    with prepare(lambda: open_source(source), options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        report = measure(prepared.run())
    for name, tracking in report.tracking_mm.items():
        print(f"{name:10s} {tracking.mean:6.1f} mm off on average")
    print(f"goals changed by the gate: {report.gated_frames}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
