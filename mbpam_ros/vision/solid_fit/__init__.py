"""Compiled fit of primitives to a contour, to edges of an image and to points of a depth camera."""
