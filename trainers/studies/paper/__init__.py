"""What serves the one paper: its plan, measurements, claims, report and shipped policies."""
