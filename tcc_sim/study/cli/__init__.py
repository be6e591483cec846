"""The verbs of the study: one module each, and one for those that measure."""
