"""Offline work on top of the package: reports, finite elements, design study."""
