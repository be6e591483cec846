"""Section states, cycles and periods of a motion -> its summary, exponents and damping."""
