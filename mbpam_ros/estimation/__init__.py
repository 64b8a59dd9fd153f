"""Bend, tip pose and available force from pressures, with their uncertainty."""
