"""Many solves: the points of a sweep, the file they go to, a cluster, exponents. Nothing here draws or prints."""
