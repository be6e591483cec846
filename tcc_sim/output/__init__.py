"""What a result is written as: new files that appear whole, tables for a terminal, samples, what a scene builds."""
