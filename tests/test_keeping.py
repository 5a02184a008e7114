"""What memory outlives a factory reset and a restored backup."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulated import servo2
from hardware.dynamixel.control_table import Register
from sim.emulator.keeping import (
    ALL,
    BUT_ID,
    BUT_ID_AND_BAUD,
    RAM_RESTORE,
    factory_reset,
    restore_eeprom,
    restore_ram,
)
from sim.emulator.registers import Memory

FIXED = {"model_number", "model_information", "firmware_version"}


def scrambled(seed: int) -> Memory:
    """A servo's memory in which every register is something else than delivered."""
    memory = servo2().memory
    for index, register in enumerate(memory.table.registers):
        if register.name not in FIXED:
            memory.store(register, 1 + (seed + 7 * index) % 100)
    return memory


def values(memory: Memory, *, eeprom: bool) -> dict[str, int]:
    end = memory.table.eeprom_end
    return {one.name: memory.value(one.name) for one in memory.table.registers if (one.address < end) is eeprom}


@pytest.mark.parametrize(("option", "spared"), [(ALL, set()), (BUT_ID, {"id"}), (BUT_ID_AND_BAUD, {"id", "baud_rate"})])
def test_a_factory_reset_spares_what_its_option_says(option: int, spared: set[str]) -> None:
    memory, delivered = scrambled(3), values(servo2().memory, eeprom=True)
    before, ram = values(memory, eeprom=True), values(memory, eeprom=False)
    assert factory_reset(memory, option)
    after = values(memory, eeprom=True)
    assert after == {name: before[name] if name in spared | FIXED else delivered[name] for name in after}
    assert after["model_number"] == 1020 and after["firmware_version"] > 0
    assert values(memory, eeprom=False) == ram  # that goes with the start that follows


@settings(max_examples=30)
@given(option=st.integers(0, 255).filter(lambda option: option not in (ALL, BUT_ID, BUT_ID_AND_BAUD)))
def test_an_unknown_option_changes_nothing(option: int) -> None:
    memory = scrambled(3)
    before = bytes(memory.image)
    assert not factory_reset(memory, option)
    assert bytes(memory.image) == before


@settings(max_examples=30)
@given(first=st.integers(0, 99), second=st.integers(0, 99))
def test_a_restored_eeprom_is_that_of_the_backup_and_the_ram_stays(first: int, second: int) -> None:
    backup, memory = scrambled(first), scrambled(second)
    backup.put("firmware_version", 1)  # of an older firmware: the servo's own stays
    ram, firmware = values(memory, eeprom=False), memory.value("firmware_version")
    restore_eeprom(memory, bytes(backup.image))
    assert values(memory, eeprom=True) == {**values(backup, eeprom=True), "firmware_version": firmware}
    assert values(memory, eeprom=False) == ram


def _comes_back(register: Register) -> bool:
    profile = register.name in ("profile_acceleration", "profile_velocity")
    return profile or register.name.endswith("_gain") or register.name.startswith("indirect_address_")


def test_a_start_brings_back_gains_profile_and_indirect_addresses_alone() -> None:
    backup, memory = scrambled(5), scrambled(40)
    memory.put("startup_configuration", RAM_RESTORE)
    before = values(memory, eeprom=False)
    restore_ram(memory, bytes(backup.image))
    wanted = {name: backup.value(name) if _comes_back(memory.table[name]) else value for name, value in before.items()}
    assert values(memory, eeprom=False) == {**wanted, "backup_ready": 1}
    assert wanted != before


@pytest.mark.parametrize(("startup", "stored"), [(0, True), (1, True), (RAM_RESTORE, False)])
def test_without_the_setting_or_a_backup_nothing_comes_back(startup: int, stored: bool) -> None:
    memory = scrambled(40)
    memory.put("startup_configuration", startup)
    before = values(memory, eeprom=False)
    restore_ram(memory, bytes(scrambled(5).image) if stored else None)
    assert values(memory, eeprom=False) == {**before, "backup_ready": int(stored)}
