"""From a model to a controller and from a measurement to a model: linearisation and identification."""
