"""Faults of the machine, one at a time, in a gripper without ROS: who sees them, how soon, and what comes of it."""
