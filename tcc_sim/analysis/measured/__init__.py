"""Samples of a run, solved, recorded or in a table -> its cycles, phase, signals, orders and spectra."""
