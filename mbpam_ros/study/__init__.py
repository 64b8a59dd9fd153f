"""Offline work on top of the package: benchmarks and reports."""
