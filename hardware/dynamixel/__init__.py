"""Dynamixel buses: packets of both protocols, control tables, ports, the cyclic exchange.

In: goal ticks. Out: servo states. Imports `hardware` only.
"""
