"""The simulated gripper: scene, tiers and contact behind one face (reset, step, observe)."""
