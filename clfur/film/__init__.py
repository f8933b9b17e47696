"""Films: pictures of moments, one after the other, in a folder or a video file."""
