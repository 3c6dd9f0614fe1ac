"""Losses of the contrastive training: InfoNCE of radar embeddings against text embeddings, and of pairs of radar embeddings.

Ref: A. van den Oord et al., arXiv:1807.03748 (InfoNCE); A. Radford et al., CLIP, ICML 2021 (loss in both directions). The docstring of
encoder.py contains the formulas.
"""

from __future__ import annotations

from radartwin.recognize.encoder import Settings


def text_loss(z, y, texts, weight, settings: Settings):
    """Return the InfoNCE loss of N radar embeddings (N, T) against the text embeddings (K, T) of all classes.

    If `settings.symmetric` is True, return the mean of two InfoNCE losses: radar embeddings against text embeddings, and text against
    radar.

    Args:
        z: torch tensor (N, T) of unit vectors.
        y: torch tensor (N,) with the number of each row's class, 0 to K - 1.
        texts: torch tensor (K, T) of unit vectors.
        weight: torch tensor (K,) with the weight of each class.
    """
    import torch
    from torch.nn.functional import cross_entropy

    logits = z @ texts.T / settings.temperature
    loss = cross_entropy(logits, y, weight=weight)
    if not settings.symmetric:
        return loss
    own = torch.nn.functional.one_hot(y, len(texts)).T.float()
    own, logits = own[own.sum(dim=1) > 0], logits.T[own.sum(dim=1) > 0]
    to_rows = -(own * logits.log_softmax(dim=1)).sum(dim=1) / own.sum(dim=1)
    return (loss + to_rows.mean()) / 2


def pair_loss(first, second, temperature: float):
    """Return the InfoNCE loss of N pairs of embeddings, averaged over both directions; pair i is row i of `first` and `second` (N, T)."""
    import torch
    from torch.nn.functional import cross_entropy

    logits = first @ second.T / temperature
    own = torch.arange(len(logits))
    return (cross_entropy(logits, own) + cross_entropy(logits.T, own)) / 2
