"""Recordings read as data: analysed, streamed to Rerun, and solved again for verification."""
