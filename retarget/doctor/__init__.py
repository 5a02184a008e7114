"""What is wrong with a stream, a servo port or this machine, and what to do about it."""
