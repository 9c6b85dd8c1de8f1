"""Contact-implicit direct transcription of the planar systems: the paper's own way to an experiment, by IPOPT."""
