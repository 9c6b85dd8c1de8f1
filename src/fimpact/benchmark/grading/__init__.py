"""Grading: answers against the sealed truth, and the lines of the claim with their intervals."""
