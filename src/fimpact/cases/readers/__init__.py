"""Readers: one for each kind of file or folder, from it to named columns."""
