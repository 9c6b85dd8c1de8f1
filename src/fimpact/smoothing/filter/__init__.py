"""The filter that solves one step of a smoother, over one run and over all."""
