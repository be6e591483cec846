"""Helpers of the study are beside this file."""
