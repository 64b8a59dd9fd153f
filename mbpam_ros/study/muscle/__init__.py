"""A muscle from its drawing: finite elements, metamodels, front and law as one run; moulds to cast it in."""
