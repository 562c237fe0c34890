"""Studies: a plan is trained, measured, and told in a report that is delivered with where it comes from."""
