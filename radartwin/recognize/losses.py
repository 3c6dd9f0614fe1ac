"""Losses of the contrastive training: InfoNCE of radar embeddings against text embeddings, and of pairs of radar embeddings.

Ref: A. van den Oord et al., arXiv:1807.03748 (InfoNCE); A. Radford et al., CLIP, ICML 2021 (loss in both directions). The docstring of
encoder.py contains the formulas.
"""

from __future__ import annotations


def text_loss(z, y, texts, weight, temperature: float):
    """Return the InfoNCE loss of N radar embeddings (N, T) against the text embeddings (K, T) of all classes.

    Args:
        z: torch tensor (N, T) of unit vectors.
        y: torch tensor (N,) with the number of each row's class, 0 to K - 1.
        texts: torch tensor (K, T) of unit vectors.
        weight: torch tensor (K,) with the weight of each class.
    """
    from torch.nn.functional import cross_entropy

    return cross_entropy(z @ texts.T / temperature, y, weight=weight)


def pair_loss(first, second, temperature: float):
    """Return the InfoNCE loss of N pairs of embeddings, averaged over both directions; pair i is row i of `first` and `second` (N, T)."""
    import torch
    from torch.nn.functional import cross_entropy

    logits = first @ second.T / temperature
    partner = torch.arange(len(logits))
    return (cross_entropy(logits, partner) + cross_entropy(logits.T, partner)) / 2
