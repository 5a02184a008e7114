"""The servo side: buses, servo data, joint <-> tick map, the guard that alone moves anything. Imports no sibling."""
