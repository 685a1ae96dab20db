"""From a body and a material to its modes and its model."""
