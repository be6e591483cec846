"""A recording read once: analysed, streamed to Rerun, and solved again from what it holds."""
