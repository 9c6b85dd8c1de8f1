"""Planting: the effects that can be put into a simulated robot, and how."""
