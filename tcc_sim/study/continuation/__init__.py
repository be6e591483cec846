"""Periodic orbits and their branches: shooting, Newton, arclength, special points, curves of bifurcations."""
