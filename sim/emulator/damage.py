"""Damaged instructions: what a parser drops without a word, though header and length were sound."""

from fastcrc.crc16 import umts

from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.packets import Error1, Error2, Instruction
from sim.emulator.device import Answer, Device


def damaged_address(protocol: int, heard: bytes) -> int | None:
    """Return the id that a frame was for which ends `heard` whole, but with a wrong CRC (2.0) or checksum (1.0)."""
    return _address2(heard) if protocol == 2 else _address1(heard)


def complaint(device: Device, now: float) -> Answer | None:
    """Return what a device says of a damaged instruction: the error, beside those that stand in all it says (as in its
    answer to a ping). None at status return level 0, where it answers pings alone."""
    answer = device.execute(Instruction.PING, b"", now, broadcast=False)
    if answer is None or not device.answers_reads:
        return None
    return Answer(answer.error | (Error2.CRC if device.protocol == 2 else Error1.CHECKSUM), b"")


def _address2(heard: bytes) -> int | None:
    at = heard.rfind(protocol2.HEADER)  # stuffing keeps headers out of frames: the last one begins the last frame
    frame = heard[at:] if at >= 0 else b""
    if len(frame) < protocol2.OVERHEAD + 3 or len(frame) != protocol2.OVERHEAD + int.from_bytes(frame[5:7], "little"):
        return None
    return frame[4] if umts(frame[:-2], 0) != int.from_bytes(frame[-2:], "little") else None


def _address1(heard: bytes) -> int | None:
    at = heard.find(protocol1.HEADER)
    frame = heard[at:] if at >= 0 else b""
    if len(frame) < protocol1.OVERHEAD + 2 or len(frame) != protocol1.OVERHEAD + frame[3]:
        return None
    return frame[2] if protocol1.checksum(frame[2:-1]) != frame[-1] else None
