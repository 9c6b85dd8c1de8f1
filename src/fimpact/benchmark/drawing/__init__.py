"""Drawing a case: a robot, its motions, what is hidden in it and how strongly."""
