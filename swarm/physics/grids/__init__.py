"""Fields and flows from data on a regular grid."""
