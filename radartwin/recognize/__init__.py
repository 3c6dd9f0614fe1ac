"""Recognise objects from radar recordings: text embeddings, encoder, linear classifiers, random forest, data checks and exported models."""
