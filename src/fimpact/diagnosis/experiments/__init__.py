"""Experiments: the one that would tell apart what recordings cannot, and what it says once it is played."""
