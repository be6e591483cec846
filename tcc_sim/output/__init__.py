"""Output of results: files written whole or not at all, lines for a terminal, samples, explanations of scenes."""
