"""Compiling, linking and caching of kernels."""
