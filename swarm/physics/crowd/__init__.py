"""What cells do to each other and to the water they share."""
