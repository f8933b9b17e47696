"""Judges of pictures: the truth, other devices, other settings; and what shows their findings."""
