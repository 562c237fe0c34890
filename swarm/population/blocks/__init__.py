"""Populations of any size, block by block."""
