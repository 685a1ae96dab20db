"""What pushes a body."""
