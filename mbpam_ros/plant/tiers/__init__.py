"""Ways to compute how muscles and object move: one face, one file a tier."""
