"""Interfaces of this machine: loopback is always there."""

from ipaddress import IPv4Address

from retarget.live.interfaces import interface_towards, local_interfaces


def test_loopback_is_listed_and_every_address_is_one() -> None:
    found = local_interfaces()
    assert found["lo"] == "127.0.0.1"
    assert all(IPv4Address(address) for address in found.values())


def test_the_way_to_ourselves_is_loopback() -> None:
    assert interface_towards("127.0.0.1") == "127.0.0.1"


def test_where_no_way_leads_there_is_no_interface() -> None:
    assert interface_towards("255.255.255.255") is None
