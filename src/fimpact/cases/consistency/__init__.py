"""Consistency: whether a recording can be what it says it is, each doubt one line with the likely cause."""
