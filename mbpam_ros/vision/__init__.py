"""Camera model, synthetic renderer and object detector."""
