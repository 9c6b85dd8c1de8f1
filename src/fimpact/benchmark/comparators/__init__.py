"""Comparators: what other tools make of the same recordings, on the benchmark's cases and on real rigs."""
