"""The same performer and robot under two files of priorities: who gives way to whom, in numbers side by side."""

import sys

from hardware.clock import VirtualClock
from retarget import RunOptions, measure, open_source
from retarget.run.prepare import prepare
from sim.mock_bus import mock_bus
from sim.performer import synthetic_performer

FILES = ("servo", "balanced")


def main(path: str | None = None) -> None:
    """Run both and print them."""

    def read():
        return open_source(path) if path else synthetic_performer().cut(0.0, 3.0)

    reports = []
    for file in FILES:
        options = RunOptions(robot="op3", priorities=file)
        with prepare(read, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
            reports.append(measure(prepared.run()))
    print(f"{'':10s}", *(f"{file:>10s}" for file in FILES))
    for name in reports[0].tracking_mm:
        print(f"{name:10s}", *(f"{report.tracking_mm[name].mean:7.1f} mm" for report in reports), "off on average")
    print(f"{'hand path':10s}", *(f"{100 * (report.hand_path_ratio or 0):8.0f} %" for report in reports))


if __name__ == "__main__":
    main(*sys.argv[1:2])
