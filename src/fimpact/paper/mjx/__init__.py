"""MJX: set up for this machine, and the sensors of the paper on it."""
