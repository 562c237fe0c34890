"""Learning: algorithms that train one shared policy, recipes, checkpoints and commands."""
