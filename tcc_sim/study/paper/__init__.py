"""Reproduction of the paper: its figures as numbers and drawings, and its claims judged by criteria in code."""
