"""A four-finger gripper of multi-directional bending pneumatic artificial muscles on ROS 2."""
