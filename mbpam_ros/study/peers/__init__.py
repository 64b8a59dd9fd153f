"""The same gripper in other simulators, and what it costs there."""
