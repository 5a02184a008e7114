"""Control tables: consistent in themselves, true to the facts, and in agreement with the maker's model files."""

import csv
import importlib.util
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.dynamixel.control_table import (
    ControlTable,
    Register,
    baud_of,
    code_of,
    fastest_baud,
    find_table,
    layer_rows,
    model_rows,
    table_of_number,
    tables,
)
from hardware.errors import HardwareError
from hardware.servo import SERVO_MODELS, Layout
from messages import refuses

X_RATES = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
ONE_RATES = {1: 1_000_000, 3: 500_000, 4: 400_000, 7: 250_000, 9: 200_000, 16: 115_200, 19: 100_000, 34: 57_600}
ONE_RATES |= {103: 19_200, 207: 9600}


def test_protocol_two_has_a_list_of_speeds_and_protocol_one_divides_two_megahertz() -> None:
    table = find_table("XM430-W350", 2)
    assert [baud_of(table, code) for code in range(9)] == [*X_RATES, None]
    assert baud_of(table, -1) is None
    small = find_table("XL330-M288", 2)
    assert [baud_of(small, code) for code in range(8)] == [*X_RATES[:7], None]
    assert code_of(small, 4_500_000) is None
    for model in ("MX-28", "AX-12A"):
        table = find_table(model, 1)
        assert {code: baud_of(table, code) for code in ONE_RATES} == ONE_RATES


TABLES = tables()
MODELS2 = tuple(dict.fromkeys(table.model for table in TABLES if table.protocol == 2))
CURRENT_MODES, LOAD_MODES = (0, 1, 3, 4, 5, 16), (1, 3, 4, 16)

all_tables = pytest.mark.parametrize("table", TABLES, ids=lambda one: f"{one.model}-{one.protocol}-{one.firmware[0]}")


@all_tables
def test_registers_lie_in_order_and_apart_and_their_values_fit(table: ControlTable) -> None:
    names = [register.name for register in table.registers]
    assert len(set(names)) == len(names)
    for one, other in pairwise(table.registers):
        assert one.end <= other.address, (one.name, other.name)
    assert table.size == table.registers[-1].end and (table.protocol == 2 or table.size <= 256)
    read_only = {"model_number", "model_information", "firmware_version", "moving", "moving_status", "realtime_tick"}
    read_only |= {"registered", "registered_instruction", "hardware_error_status", "backup_ready"}
    for register in table.registers:
        name, in_eeprom = register.name, register.address < table.eeprom_end
        assert register.size in (1, 2, 4)
        assert register.end <= table.eeprom_end or not in_eeprom, name
        assert (register.lowest is None) == (register.highest is None), name
        for limit in (register.lowest, register.highest, register.initial):
            assert limit is None or register.narrowest <= limit <= register.widest, name
        if register.lowest is not None and register.highest is not None:
            assert register.lowest < register.highest, name
        assert register.initial is None or register.allows(register.initial), name
        assert (register.scale is None) == (register.unit is None), name
        assert register.scale is None or register.scale > 0.0, name
        measured = name in read_only or name.startswith("present_") or name.endswith("_trajectory")
        assert register.writable != measured, name
        assert not register.writable or register.lowest is not None, name
        assert not (register.writable and in_eeprom) or register.initial is not None, f"{name}: nothing else fills it"


@all_tables
def test_signs_are_the_makers(table: ControlTable) -> None:
    signed = {register.name for register in table.registers if register.signed}
    if table.layout is Layout.X:
        wanted = {"homing_offset", "bus_watchdog", "goal_pwm", "goal_current", "goal_velocity", "goal_position"}
        wanted |= {"present_pwm", "present_current", "present_load", "present_velocity", "present_position"}
        wanted |= {"velocity_trajectory", "position_trajectory"}
        assert signed == {name for name in wanted if table.has(name)}
        return
    by_bit = {register.name for register in table.registers if register.direction_bit == 10}
    assert by_bit == {"moving_speed", "present_speed", "present_load"} | (
        {"goal_torque"} if table.has("goal_torque") else set()
    )
    turns = set() if SERVO_MODELS[table.model].ticks == 1024 else {"goal_position", "present_position"}
    turns |= {"multi_turn_offset"} if table.has("multi_turn_offset") else set()
    assert signed == by_bit | turns


@all_tables
def test_scales_agree_with_the_servo_model(table: ControlTable) -> None:
    model = SERVO_MODELS[table.model]
    assert table["present_position"].scale == pytest.approx(model.tick_rad, rel=1e-12)
    assert table["goal_position"].scale == table["present_position"].scale
    if table.layout is Layout.X:
        assert table.has("present_current") == (model.current_unit is not None)
        assert table.has("present_load") == (model.current_unit is None)
        assert table.modes == (LOAD_MODES if model.current_unit is None else CURRENT_MODES)
        assert table["goal_velocity"].scale == pytest.approx(0.229 * 2 * 3.141592653589793 / 60, rel=1e-12)
    else:
        assert table.modes == ()
    for name in ("current_limit", "goal_current", "present_current"):
        if table.has(name):
            assert table[name].scale == pytest.approx(model.current_unit)
            assert table[name].unit == "A"


def test_every_model_has_tables_for_every_firmware() -> None:
    assert {table.model for table in TABLES} == set(SERVO_MODELS)
    numbers = {(table.model, table.protocol): table.number for table in TABLES}
    assert len(set(numbers.values())) == len(numbers)
    for (model, protocol), number in numbers.items():
        ranges = sorted(one.firmware for one in TABLES if (one.model, one.protocol) == (model, protocol))
        assert ranges[0][0] == 0
        assert ranges[-1][1] == 255
        assert all(one[1] + 1 == other[0] for one, other in pairwise(ranges))
        for first, last in ranges:
            table = find_table(model, protocol, last)
            assert table is find_table(model, protocol, first) is table_of_number(number, last)
            assert first <= table.usual_firmware <= last
        usual = find_table(model, protocol)
        assert usual is find_table(model, protocol, usual.usual_firmware) is table_of_number(number)
        assert usual["model_number"].initial == number


FIRST = {
    # number, limits of current and velocity, velocity I and P, position D, I and P, shutdown; V at most
    "XL330-M288": (1200, 1750, 445, 1600, 180, 0, 0, 400, 53, 70),
    "XL330-M077": (1190, 1750, 1620, 400, 40, 0, 400, 400, 53, 70),
    "XC330-M288": (1240, 2352, 350, 1600, 50, 500, 0, 1100, 52, 70),
    "XC330-M181": (1230, 2352, 545, 1400, 100, 500, 0, 1200, 52, 70),
    "XC330-T288": (1220, 910, 320, 1200, 40, 0, 0, 900, 52, 140),
    "XH540-W270": (1100, 2047, 167, 1920, 100, 0, 0, 800, 52, 160),
    "XH540-W150": (1110, 2047, 300, 1920, 100, 0, 0, 800, 52, 160),
    "XM540-W270": (1120, 2047, 128, 1920, 100, 0, 0, 800, 52, 160),
    "XM540-W150": (1130, 2047, 230, 1920, 100, 0, 0, 800, 52, 160),
}
"""First values of models, typed from the e-Manual a second time."""


@pytest.mark.parametrize("model", FIRST)
def test_first_values_are_the_manuals(model: str) -> None:
    names = ["model_number", "current_limit", "velocity_limit", "velocity_i_gain", "velocity_p_gain", "position_d_gain"]
    names += ("position_i_gain", "position_p_gain", "shutdown", "max_voltage_limit")
    table = find_table(model, 2)
    assert tuple(table[name].initial for name in names) == FIRST[model]
    assert table["goal_current"].highest == table["current_limit"].highest == table["current_limit"].initial


def test_first_values_of_the_older_layout_are_the_manuals() -> None:
    names = ["baud_rate", "control_mode", "temperature_limit", "min_voltage_limit", "max_voltage_limit", "max_torque"]
    names += ("shutdown", "d_gain", "i_gain", "p_gain", "punch")
    table = find_table("XL-320", 2)
    assert tuple(table[name].initial for name in names) == (3, 2, 65, 60, 90, 1023, 3, 0, 0, 32, 32)
    assert [baud_of(table, code) for code in range(5)] == [9600, 57_600, 115_200, 1_000_000, None]
    assert code_of(table, 200_000) is None and fastest_baud(table) == 1_000_000


def test_hardware_errors_mean_the_same_in_every_layout() -> None:
    """e-Manual: of an X model bit 0 is voltage, 2 heat, 5 overload; of an XL-320 0 overload, 1 heat, 2 voltage."""
    x, older = (find_table(model, 2)["hardware_error_status"] for model in ("XM430-W350", "XL-320"))
    for byte, same in ((1, 32), (2, 4), (4, 1), (7, 37)):
        assert older.decode(bytes((byte,))) == x.decode(bytes((same,))) == same
        assert older.encode(same) == bytes((byte,))


@pytest.mark.parametrize(
    ("model", "since"),
    [("XM430-W350", 45), ("XL430-W250", 45), ("XC430-W240", 45), ("XH540-W270", 45), ("XL330-M288", 46)],
)
def test_fast_reads_startup_and_backup_come_with_firmware(model: str, since: int) -> None:
    old, new = find_table(model, 2, since - 1), find_table(model, 2, since)
    assert (old.fast_read, new.fast_read) == (False, True)
    for name in ("startup_configuration", "backup_ready"):
        assert (old.has(name), new.has(name)) == (False, True)
    assert not old["drive_mode"].allows(8)
    assert new["drive_mode"].allows(8)
    assert find_table(model, 2).fast_read


def test_errors_name_what_there_is() -> None:
    with refuses(HardwareError, "XL430-W250", "2.0", "goal_current", "goal_position"):
        find_table("XL430-W250", 2)["goal_current"]
    for model, protocol in (("AX-12A", 2), ("XL-320", 1)):
        with refuses(HardwareError, model, "2.0", "1.0"):
            find_table(model, protocol)
    with refuses(HardwareError, "XM430-W350"):
        find_table("XM999", 2)
    assert find_table("XM430-W350-R", 2) is find_table("XM430-W350", 2)
    assert table_of_number(4711) is None
    assert not find_table("MX-28", 2).has("goal_current")


# ---- the maker's own model files, as dynamixel-sdk ships them
OTHER_NAMES = {"secondary(shadow)_id": "secondary_id"}
# Windows that the maker's host software sets up inside the indirect area: places of its own choice, not registers.
WINDOWS = {"indirect_address_write", "indirect_data_write", "indirect_address_read", "indirect_data_read"}
# In the e-Manual from firmware 45 (X330: 46) on; the maker's files leave them out.
NOT_IN_FILES = {"startup_configuration", "backup_ready"}


def _maker_folder() -> Path:
    spec = importlib.util.find_spec("dynamixel_easy_sdk")
    folder = Path(next(iter(spec.submodule_search_locations or [""]))) / "control_table" if spec else Path("none")
    if not (folder / "dynamixel.model").is_file():
        pytest.skip("this dynamixel-sdk ships no model files")
    return folder


def _section(file: Path, title: str) -> list[list[str]]:
    lines = [line.rstrip("\r\n") for line in file.read_text(encoding="utf-8-sig").splitlines()]
    rows = list(csv.reader(lines[lines.index(title) + 2 :], delimiter="\t"))
    return rows[: next((place for place, row in enumerate(rows) if not row), len(rows))]


@pytest.mark.parametrize("model", MODELS2)
def test_tables_agree_with_the_makers_files(model: str) -> None:
    folder = _maker_folder()
    listed = dict(row for row in csv.reader((folder / "dynamixel.model").read_text().splitlines()[1:], delimiter="\t"))
    newest = find_table(model, 2, 255)
    file = folder / listed[str(newest.number)]
    versions = [(file, newest)]
    older = file.with_name(f"{file.stem}_fw52.model")
    if older.is_file():
        versions.append((older, find_table(model, 2, 52)))
    assert len(versions) == (2 if "330" in model else 1)
    for path, table in versions:
        theirs = {}
        for address, size, name in _section(path, "[control table]"):
            snake = name.strip().lower().replace(" ", "_")
            theirs[OTHER_NAMES.get(snake, snake)] = (int(address), int(size))
        ours = {register.name: (register.address, register.size) for register in table.registers}
        for name in WINDOWS if table.layout is Layout.X else ():
            place, _ = theirs.pop(name)
            (covering,) = (one for one in table.registers if one.address <= place < one.end)
            assert covering.name.startswith(name.rpartition("_")[0])
        assert {name: ours.get(name) for name in theirs} == theirs
        extra = {name for name in ours if name not in theirs and not name.startswith("indirect_")}
        assert extra == {name for name in NOT_IN_FILES if table.has(name)}
        for name, value, unit, sign in _section(path, "[unit info]"):
            if table.layout is Layout.OLDER and name.endswith(" Velocity"):
                continue  # their file of the XL-320 gives units of registers that it does not have
            register = table[name.lower().replace(" ", "_")]
            assert register.signed == (sign == "signed"), register.name
            if unit == "rad/s":  # they write 0.22889 rpm where the e-Manual rounds to 0.229
                assert register.scale == pytest.approx(float(value), rel=6e-4)


PLACES = {"layer", "name", "since", "until"}
COLUMNS = {"address", "size", "sign", "access", "scale", "unit", "lowest", "highest", "initial"}


def test_every_layer_is_used_and_every_row_of_a_model_has_an_effect() -> None:
    """A row that changes a register that no row has made has a misspelt name."""
    assert {layer for model in model_rows() for layer in model.layers} == set(layer_rows())
    for model in model_rows():
        made: set[str] = set()
        for layer in model.layers:
            for row in layer_rows()[layer]:
                name = row["name"]
                assert set() < set(row) - PLACES <= COLUMNS
                assert ("address" in row) == ("size" in row) == ("sign" in row and "access" in row)
                assert 0 <= int(row.get("since", 0)) <= int(row.get("until", 255)) <= 255
                made |= {name} if "address" in row else set()
                assert name in made, f"{model.model}, {layer}: {name} changes a register that does not exist"


def _register(*, size: int = 2, signed: bool = False, direction_bit: int | None = None) -> Register:
    return Register("some", 10, size, signed, True, None, None, None, None, None, direction_bit)


REGISTERS = [_register(size=size, signed=signed) for size in (1, 2, 4) for signed in (False, True)]
SPEED = _register(signed=True, direction_bit=10)


@pytest.mark.parametrize(
    ("register", "counts", "data"),
    [
        (_register(size=4, signed=True), -1, "ffffffff"),
        (_register(size=4, signed=True), -131073, "fffffdff"),
        (_register(size=2), 65535, "ffff"),
        (_register(size=2, signed=True), -2, "feff"),
        (_register(size=1, signed=True), -1, "ff"),
        (SPEED, 300, "2c01"),
        (SPEED, -300, "2c05"),
        (SPEED, -1023, "ff07"),
        (SPEED, 0, "0000"),
    ],
)
def test_bytes_are_known(register: Register, counts: int, data: str) -> None:
    assert register.encode(counts).hex() == data
    assert register.decode(bytes.fromhex(data)) == counts


@settings(max_examples=100)
@given(register=st.sampled_from([*REGISTERS, SPEED]), data=st.data())
def test_every_count_survives_the_wire_and_every_byte_string_has_one(register: Register, data: st.DataObject) -> None:
    counts = data.draw(st.integers(register.narrowest, register.widest))
    assert register.decode(register.encode(counts)) == counts
    raw = data.draw(st.binary(min_size=register.size, max_size=register.size))
    assert register.narrowest <= register.decode(raw) <= register.widest


@pytest.mark.parametrize("register", [*REGISTERS, SPEED])
def test_counts_beyond_the_width_and_data_of_another_length_are_refused(register: Register) -> None:
    for counts in (register.narrowest - 1, register.widest + 1):
        with refuses(ValueError):
            register.encode(counts)
    for size in sorted({0, register.size - 1, register.size + 1}):
        with refuses(ValueError, register.size):
            register.decode(bytes(size))
