"""Recognition: text anchors, the contrastive encoder, probes and forest, the guards of the protocol, and models that leave the study."""
