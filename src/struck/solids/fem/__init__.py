"""Finite elements: stiffness and mass, eigenpairs, and their errors."""
