"""The improved model for plain MuJoCo: an MJCF and, for laws that it cannot hold, a Python file beside it."""
