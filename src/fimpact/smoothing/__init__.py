"""Smoothing: the trajectory and the force that the model lacks, estimated together from the recordings."""
