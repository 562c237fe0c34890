"""Settings of a training run, typed, composed and checked."""
