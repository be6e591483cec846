"""Pictures (matplotlib) and streams to Rerun; no other modules import these two packages."""
