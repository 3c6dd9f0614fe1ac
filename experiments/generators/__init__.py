"""Scripts that write data files of the package: text embeddings of the objects, questions about surfaces, and repeatability limits."""
