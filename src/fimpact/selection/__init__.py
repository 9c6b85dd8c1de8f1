"""Selection: which physics a smoothed recording asks for, judged on stretches that were not fitted."""
