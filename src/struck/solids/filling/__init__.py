"""Tetrahedra that fill any closed surface."""
