"""Log to Weights & Biases or MLflow with their own clients (docs/tracking.md)."""
