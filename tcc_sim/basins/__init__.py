"""Basins of attraction: attractors, to which of them a motion has come, and the cells of a plane."""
