"""The one place that compiles, links and keeps compiled kernels."""
