"""Policies as files: read an ONNX network and its card with only NumPy and ONNX Runtime."""
