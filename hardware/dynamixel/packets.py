"""What both protocols have in common: instructions, identifiers, the frame that a parser returns."""

from enum import IntEnum, IntFlag
from typing import NamedTuple

BROADCAST = 0xFE
"""Every device on the line."""
MAX_ID = 252
"""Highest id of a device in protocol 2.0 (1.0: 253)."""
STATUS = 0x55
"""Instruction code of a status frame, protocol 2.0."""
ALERT = 0x80
"""Bit 7 of a 2.0 status frame's error byte: a Hardware Error Status bit is set; the data are valid."""


class Instruction(IntEnum):
    """Instruction codes (e-Manual, protocols 1.0 and 2.0)."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    CONTROL_TABLE_BACKUP = 0x20
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class Error2(IntEnum):
    """Error number of a 2.0 status frame, bits 0 to 6."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


class Error1(IntFlag):
    """Error bits of a 1.0 status frame."""

    INPUT_VOLTAGE = 0x01
    ANGLE_LIMIT = 0x02
    OVERHEATING = 0x04
    RANGE = 0x08
    CHECKSUM = 0x10
    OVERLOAD = 0x20
    INSTRUCTION = 0x40


class Frame(NamedTuple):
    """One valid frame of a line, stuffing removed.

    code: the instruction; of a 2.0 status frame STATUS; of a 1.0 status frame its error byte, since a 1.0 frame does
    not show its sender. params: what follows, without CRC or checksum (a 2.0 status frame: error byte, then data).
    """

    id: int
    code: int
    params: bytes


class Status(NamedTuple):
    """What one device answered."""

    id: int
    error: int
    data: bytes


# The answers of several servos to one request, side by side.
