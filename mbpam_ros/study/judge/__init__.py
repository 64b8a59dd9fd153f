"""The object detector judged by images that are not ours: random scenes drawn by MuJoCo, off-screen."""
