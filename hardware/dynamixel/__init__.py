"""The Dynamixel side of a bus: packets of both protocols, control tables, ports, the cyclic exchange, the bus."""
