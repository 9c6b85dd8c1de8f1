"""The simulated robots, an MJCF each."""
