"""What came out: rollouts of populations, their results and statistics."""
