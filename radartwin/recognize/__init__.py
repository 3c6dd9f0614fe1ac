"""Recognition: text embeddings, contrastive encoder, linear probes, random forest, checks of the training data, and exported models."""
