"""`Trainer`, optimizers, checkpoints."""
