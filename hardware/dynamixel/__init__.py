"""Dynamixel buses: packets of both protocols, control tables, ports, the cyclic exchange.

In: goal ticks. Out: servo states. Imports `hardware` only. A function that uses a port raises BusError once the port is lost.
"""
