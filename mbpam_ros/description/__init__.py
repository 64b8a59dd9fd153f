"""What the gripper looks like and where its frames are, for whoever draws it or plans with it."""
