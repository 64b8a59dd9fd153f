"""The measuring rig: one muscle's bend and force over pressure, and the factors of its law that follow."""
