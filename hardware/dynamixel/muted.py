"""Servos whose Status Return Level is 0: they answer pings, obey in silence, and say nothing else."""

from hardware.bus_spec import BusSpec
from hardware.dynamixel.one_off import OneOff
from hardware.dynamixel.register import Register
from hardware.dynamixel.servo_error import NoAnswer
from hardware.dynamixel.settings import ANSWER_ALL
from hardware.dynamixel.setup_plan import setup_command

LEVEL = {
    1: Register("status_return_level", 16, 1, False, True, None, None, 0, 2, ANSWER_ALL),
    2: Register("status_return_level", 68, 1, False, True, None, None, 0, 2, ANSWER_ALL),
}
"""By protocol: every model has it there."""
PINGS_ONLY = "answers pings only (status return level 0)"


def answers_pings_only(client: OneOff, device: int) -> bool:
    """Whether it is there, and gives no answer to a read. Raises BusError when the port is gone."""
    try:
        client.read(device, LEVEL[client.protocol])
    except NoAnswer as silence:
        found = client.ping(device)
        return not silence.damaged and found is not None and not found.clash
    return False


def muted_text(bus: BusSpec, device: int) -> str:
    """What is wrong with it, and what a person types."""
    return f"{PINGS_ONLY}: {setup_command(bus, device, {LEVEL[bus.protocol].name: ANSWER_ALL})}"


def unmute(client: OneOff, device: int) -> None:
    """Have it answer everything, and see that it does. Raises BusError (NoAnswer, ServoError) when it does not."""
    client.write(device, LEVEL[client.protocol], ANSWER_ALL, verify=True)
