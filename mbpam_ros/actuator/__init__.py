"""The muscle: design and its domain, chambers and directions, metamodels, rod law, kinematics."""
