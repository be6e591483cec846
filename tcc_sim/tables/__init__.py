"""Tables of measurements: text, Parquet, MATLAB, MDF and TDMS files; their columns, units, times and holes."""
