"""Style and scenes of pictures, which the paper and the benchmark draw with as well."""
