"""A detector of objects in images, by a neural network (ONNX), and the recipe step that uses it."""
