"""Log to Weights & Biases or MLflow through the client of each service (docs/tracking.md)."""
