"""The entries of the catalogue, a module for each family: law, prior, places, probes and export of each effect."""
