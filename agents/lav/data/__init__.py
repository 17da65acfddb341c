"""Training samples of LAV from datasets."""
