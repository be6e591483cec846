"""Tables of measurements: CSV and other text, Parquet, MATLAB and MDF files; their columns, units, times and holes."""
