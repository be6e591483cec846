"""The adaptive engine of the smoothed law (7): Taylor series in slip, collocation in the layer and in stick."""
