"""Design study of the muscle: sampling, metamodels beside each other, and the best compromise of angle and force."""
