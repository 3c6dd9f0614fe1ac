"""Recognition: text anchors, contrastive encoder, probes and forest, checks of what training may see, and exported models."""
