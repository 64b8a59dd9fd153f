"""Grasps of the paper, run without ROS: which pressures hold which object, and by what."""
