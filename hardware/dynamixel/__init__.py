"""Dynamixel buses: packets of both protocols, control tables, ports, the cyclic exchange.

In: goal ticks. Out: servo states. Imports `hardware` only.
Functions that use a port raise BusError once it is lost.
"""
