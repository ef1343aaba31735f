"""Policies as files: reading an ONNX network and its card with NumPy and ONNX Runtime alone."""
