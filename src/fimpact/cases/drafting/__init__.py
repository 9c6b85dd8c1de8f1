"""Drafting a first case from an MJCF and its logs."""
