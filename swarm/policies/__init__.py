"""What a cell does: strategies, networks and their files."""
