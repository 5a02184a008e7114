"""What a 2.0 servo's memory holds after a start, a factory reset and a restore of its backup.

Source: e-Manual, protocol 2.0 (06 Factory Reset, 20 Control Table Backup), Startup Configuration (60).
"""

from hardware.dynamixel.control_table import Register
from sim.emulator.registers import Memory

RAM_RESTORE = 0x02  # bit of Startup Configuration
ALL, BUT_ID, BUT_ID_AND_BAUD = 0xFF, 0x01, 0x02
"""Options of a factory reset."""
_FIXED = frozenset(("model_number", "model_information", "firmware_version"))
_SPARED = {ALL: frozenset[str](), BUT_ID: frozenset(("id",)), BUT_ID_AND_BAUD: frozenset(("id", "baud_rate"))}
_PROFILE = frozenset(("profile_acceleration", "profile_velocity"))


def factory_reset(memory: Memory, option: int) -> bool:
    """Set the EEPROM area to the maker's values, what the option spares apart; False for an unknown option."""
    spared = _SPARED.get(option)
    if spared is None:
        return False
    for register in memory.table.registers:
        if register.address < memory.table.eeprom_end and register.name not in spared | _FIXED:
            memory.store(register, register.initial or 0)
    return True


def restore_eeprom(memory: Memory, backup: bytes) -> None:
    """Set the EEPROM area to what the backup holds."""
    for register in memory.table.registers:
        if register.address < memory.table.eeprom_end and register.name not in _FIXED:
            _copy(memory, backup, register)


def restore_ram(memory: Memory, backup: bytes | None) -> None:
    """Set gains, profile and indirect addresses to what the backup holds, where the startup configuration says so."""
    memory.put("backup_ready", int(backup is not None))
    if backup is None or not memory.value_or("startup_configuration", 0) & RAM_RESTORE:
        return
    for register in memory.table.registers:
        name = register.name
        if name.endswith("_gain") or name in _PROFILE or name.startswith("indirect_address_"):
            _copy(memory, backup, register)


def _copy(memory: Memory, backup: bytes, register: Register) -> None:
    memory.image[register.address : register.end] = backup[register.address : register.end]
