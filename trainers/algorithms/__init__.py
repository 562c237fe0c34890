"""Ways to learn: what the training loop needs of one (`base`), and those there are."""
