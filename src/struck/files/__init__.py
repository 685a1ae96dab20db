"""Files: meshes, models and volume meshes, in and out."""
