"""The blind benchmark: effects concealed in simulated robots, diagnosed blind, graded against the sealed truth."""
