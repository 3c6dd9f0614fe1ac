"""A plug-in of every kind: a simulator, a material source, a feature set, an encoder and an experiment."""
