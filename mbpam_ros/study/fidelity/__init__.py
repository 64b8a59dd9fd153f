"""What accuracy costs: tiers, modes, steps and pneumatic models run over cases and set beside a converged reference."""
