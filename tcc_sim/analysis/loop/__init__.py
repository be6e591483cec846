"""A run under control -> target, errors, manoeuvres, and the verdict on its end."""
