"""Basins of attraction: attractors, assignment of motions to them, and the cells of a plane."""
