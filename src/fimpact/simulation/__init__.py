"""Forward simulation by MuJoCo C of a recording's runs, under a hypothesis about what its model lacks."""
