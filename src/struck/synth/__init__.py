"""From modes and pushes to samples."""
