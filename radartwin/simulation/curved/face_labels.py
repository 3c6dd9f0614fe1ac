"""How the faces a tube met are packed into one number: 1 + label of each, the last in the lowest bits."""

LABEL_BITS = 12  # per bounce: five bounces in 64 bits
OTHER = (1 << LABEL_BITS) - 2  # the largest label: whatever has no label of its own


def unpack(sequence: int, bounces: int) -> tuple[int, ...]:
    """Labels of the faces met, first to last.

    >>> unpack((3 << LABEL_BITS) + 8, 2)
    (2, 7)
    """
    return tuple(((sequence >> (LABEL_BITS * (bounces - 1 - i))) & (1 << LABEL_BITS) - 1) - 1 for i in range(bounces))
