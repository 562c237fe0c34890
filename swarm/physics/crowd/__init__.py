"""The crowd: what cells do to the medium that they share, and to each other."""
