"""Learning algorithms: TorchRL's parts put together."""
