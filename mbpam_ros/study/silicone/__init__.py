"""From a tensile test to the constants of a silicone: the fit of the paper's Fig. 4a."""
