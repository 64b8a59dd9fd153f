"""Solids and rotations: shapes, sizes, inertia, distances."""
