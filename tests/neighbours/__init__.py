"""Other libraries beside this one: what installs, steps and trains, each in an environment of its own."""
