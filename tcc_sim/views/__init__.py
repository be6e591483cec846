"""What people look at: pictures (matplotlib) and streams to Rerun; the only modules that import either."""
