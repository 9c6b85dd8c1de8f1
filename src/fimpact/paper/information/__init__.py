"""Sensitivities through contact: rollouts, Fisher information and its trace, and the compiled programs of both."""
