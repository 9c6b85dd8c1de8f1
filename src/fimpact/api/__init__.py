"""The public API: everything that the command line does, for a notebook or a script; `fimpact` has its names."""
