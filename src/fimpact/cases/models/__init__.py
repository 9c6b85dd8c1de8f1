"""The naive MJCF of a case: read whole, checked, compiled, with the sensors that its log needs."""
