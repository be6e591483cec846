"""The exact engine of the set-valued law (6): arcs of one mode each, joined at located events."""
