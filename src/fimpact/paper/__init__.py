"""The paper: experiment design by Fisher information through contact, on JAX and MJX."""
