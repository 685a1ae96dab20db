"""What was recorded, where it was struck, and the stretches that ring freely."""
