"""The model along a trajectory: one sample ahead, its derivatives, and what laws and edits do as forces."""
