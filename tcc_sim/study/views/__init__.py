"""Pictures of branches and basins."""
