"""Diagnosis: from a recording to what may be said of it, with its proof."""
