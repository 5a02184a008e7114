"""Find the serial port of the adapter: that of the profile, or the one that vanishes when it is unplugged."""

from pathlib import Path

from hardware.bus import BusSpec
from hardware.dynamixel.serial_port import existing_ports, no_such_port, ports_text, stable_name
from retarget.cli.application import answered, confirmed
from retarget.cli.exit import echo

WHERE = "servo (--port PATH names the port)"
TERMINAL = "Run it in a terminal; --port emulator shows it without servos"


def port_of_bus(bus: BusSpec, *, yes: bool) -> str:
    """The port of a bus: that of the profile if it exists and the operator (or `yes`) agrees, else found by unplugging
    the adapter. Raises BusError if it does not exist and `yes`."""
    if not Path(bus.port).exists():
        if yes:
            raise no_such_port(bus.port)
        echo(f"bus {bus.name}: {bus.port}, the port of the profile, does not exist")
    elif yes or confirmed(f"bus {bus.name}: use {bus.port}, the port of the profile?", where=WHERE):
        return bus.port
    found = unplugged_port()
    echo(f"the port is {found}; as `port` of bus {bus.name} in the profile it need not be found again")
    return found


def unplugged_port() -> str:
    """The stable name of the port of the adapter that the operator unplugs and plugs in again. Raises UsageError at
    the end of the input."""
    while True:
        before = existing_ports()
        echo(f"ports: {ports_text(before)}")
        if not before:
            _enter("Plug the adapter in, then press ENTER")
            continue
        _enter("Unplug the adapter, then press ENTER")
        left = existing_ports()
        gone = [path for path in before if path not in left]
        if len(gone) != 1:
            echo(
                "no port went away. Ctrl-C ends this, --port PATH names the port"
                if not gone
                else f"{len(gone)} ports went away: {', '.join(gone)}. Unplug one"
            )
            continue
        echo(f"{gone[0]} went away: that is the adapter")
        back: list[str] = []
        while not back:
            _enter("Plug it in again, then press ENTER")
            back = [path for path in existing_ports() if path not in left]
        if len(back) == 1:
            return stable_name(back[0])
        echo(f"{len(back)} ports came: {', '.join(back)}. Plug in one")


def _enter(text: str) -> None:
    answered(f"{text}: ", where=WHERE, step=TERMINAL)
