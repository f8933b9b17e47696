"""Strands that move: it stands before the scene, so that drawing needs to know nothing of time."""
